"""Training and test samples: rows, folds, cross-validation."""
