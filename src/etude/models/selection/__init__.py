"""Which structure explains each command best: candidates, comparison, averaging."""

PUBLIC = ("linear", "model_selection")
"""Modules that may be used from outside."""
