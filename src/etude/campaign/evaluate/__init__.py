"""How good is it, and is it enough: status, stop rule, confirmation."""

PUBLIC = ("confirm",)
"""Modules that may be used from outside."""
