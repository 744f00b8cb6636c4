"""Gaussian processes: kernels, exact and approximate posteriors, training. See docs/models.md."""
