"""A campaign with a simulated robot in place of the real one."""

PUBLIC = ("simulation",)
"""Modules that may be used from outside."""
