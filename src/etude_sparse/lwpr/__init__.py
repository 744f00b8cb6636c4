"""Locally weighted projection regression: no Gaussian process, but it answers like one where it can."""

PUBLIC = ("regression",)
"""Modules that may be used from outside."""
