"""Is this log plausible, and how well was it recorded? One module a test."""

PUBLIC = ("filtered_motion", "finding_texts", "plausibility")
"""Modules that may be used from outside."""
