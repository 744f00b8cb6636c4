"""What a campaign came to, as one page."""

PUBLIC = ("live", "markup", "scales", "svg")
"""Modules that may be used from outside."""
