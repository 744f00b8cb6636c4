"""What a campaign came to, as one page."""

PUBLIC = ()
"""Modules that may be used from outside."""
