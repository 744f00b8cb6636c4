"""Which samples teach, and what is held out: rows, folds, cross-validation."""

PUBLIC = ("cross_validation", "fit")
"""Modules that may be used from outside."""
