"""What a campaign came to, as one page."""

PUBLIC = ("markup", "scales", "svg")
"""Modules that may be used from outside."""
