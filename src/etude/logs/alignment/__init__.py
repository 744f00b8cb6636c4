"""Which motion a log shows, and when it starts."""

PUBLIC = ("tracking_errors",)
"""Modules that may be used from outside."""
