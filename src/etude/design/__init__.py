"""What to run next: criteria, reference states, one objective and one search."""

PUBLIC = ("config", "criteria", "objective", "reference", "refine", "solve")
"""Modules that may be used from outside."""
