"""Which motion a log shows, and when it starts."""

PUBLIC = ("tracked",)
"""Modules that may be used from outside."""
