"""What to run next: criteria, reference states, one objective and one search."""

PUBLIC = ("aim", "candidates", "chain", "config", "criteria", "latents", "objective", "solve")
"""Modules that may be used from outside."""
