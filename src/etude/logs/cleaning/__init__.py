"""Repairs and filters: ranges, outliers, delays, smoothing, derivatives."""
