"""Gaussian processes: kernels, exact and approximate posteriors, training. See docs/models.md."""

PUBLIC = (
    "exact",
    "fixed_inducing",
    "inducing",
    "inducing_training",
    "kernel_algebra",
    "kernels",
    "minimize",
    "single_point",
    "training",
)
"""Modules that may be used from outside."""
