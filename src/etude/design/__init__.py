"""What to run next: criteria, reference states, one objective and one search."""

PUBLIC = (
    "aim",
    "candidates",
    "chain",
    "config",
    "criteria",
    "objective",
    "prior",
    "reference",
    "refine",
    "solve",
)
"""Modules that may be used from outside."""
