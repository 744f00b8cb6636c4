"""Sparse members that no default uses: dictionaries, sparse spectra, online and local models."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_sparse.dictionary import DictionaryConfig, DictionaryGP
    from etude_sparse.dictionary_stream import DictionaryStream
    from etude_sparse.downsampling import DownsampledGP
    from etude_sparse.incremental_spectrum import IncrementalSpectrum
    from etude_sparse.local import LocalGP
    from etude_sparse.lwpr.regression import LWPR
    from etude_sparse.sogp import SOGP, OnlineProcess
    from etude_sparse.sparse_spectrum import SparseSpectrumGP
    from etude_sparse.sparse_spectrum_training import fit_sparse_spectrum, initial_sparse_spectrum
    from etude_sparse.spectral_posterior import SpectralFeatures

__all__ = [
    "LWPR",
    "SOGP",
    "DictionaryConfig",
    "DictionaryGP",
    "DictionaryStream",
    "DownsampledGP",
    "IncrementalSpectrum",
    "LocalGP",
    "OnlineProcess",
    "SparseSpectrumGP",
    "SpectralFeatures",
    "fit_sparse_spectrum",
    "initial_sparse_spectrum",
]
__getattr__, __dir__ = face(__name__)
