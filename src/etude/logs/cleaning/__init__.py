"""Repairs and filters: ranges, outliers, delays, smoothing, derivatives."""

PUBLIC = ("filters", "read")
"""Modules that may be used from outside."""
