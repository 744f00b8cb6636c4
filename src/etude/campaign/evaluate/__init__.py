"""How good is it, and is it enough: status, stop rule, confirmation."""

PUBLIC = ("expected_tracking_error",)
"""Modules that may be used from outside."""
