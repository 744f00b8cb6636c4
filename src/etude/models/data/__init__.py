"""Which samples teach, and what is held out: rows, folds, cross-validation."""
