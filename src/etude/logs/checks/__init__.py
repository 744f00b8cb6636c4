"""Is this log plausible, and how well was it recorded? One module a test."""

PUBLIC = ("judge", "seen", "words")
"""Modules that may be used from outside."""
