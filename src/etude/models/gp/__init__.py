"""Gaussian processes: kernels, exact and approximate posteriors, training. See docs/models.md."""

PUBLIC = (
    "dictionary",
    "dictionary_stream",
    "downsampled",
    "exact",
    "fixed_inducing",
    "inducing",
    "inducing_training",
    "kernel_algebra",
    "kernels",
    "local",
    "minimize",
    "single_point",
    "sogp",
    "sparse_spectrum",
    "sparse_spectrum_training",
    "spectral_features",
    "training",
)
"""Modules that may be used from outside."""
