"""Is this log true? One module a test: each takes what was seen of a motion and gives findings."""

PUBLIC = ("judge", "seen", "words")
"""Modules that may be used from outside."""
