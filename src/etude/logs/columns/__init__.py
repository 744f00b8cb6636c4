"""From raw columns to a kind's channels: names, units, indices, gaps."""

PUBLIC = ("mapping",)
"""Modules that may be used from outside."""
