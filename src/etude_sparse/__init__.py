"""Members that no default uses: dictionaries, sparse spectra, online and local models."""

PUBLIC = (
    "dictionary",
    "dictionary_stream",
    "downsampling",
    "local",
    "sogp",
    "sparse_spectrum",
    "sparse_spectrum_training",
    "spectral_posterior",
)
"""Modules that may be used from outside."""
