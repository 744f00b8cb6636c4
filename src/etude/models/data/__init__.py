"""Training data: rows, folds, cross-validation."""
