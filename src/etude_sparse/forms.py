"""How the posteriors of sparse members are stored, as rows of `etude.forms`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from etude.models.forms import Form, Lookup, Words, kernel_of

if TYPE_CHECKING:  # what is not stored is not loaded
    from etude_sparse.local_posterior import LocalPosterior
    from etude_sparse.lwpr.posterior import LWPRPosterior
    from etude_sparse.spectral_posterior import SparseSpectrumPosterior


def _spectrum(words: Words, array: Lookup) -> SparseSpectrumPosterior:
    from etude_sparse.spectral_features import SpectralFeatures
    from etude_sparse.spectral_posterior import SparseSpectrumPosterior

    return SparseSpectrumPosterior(
        SpectralFeatures(array("frequencies")),
        float(words["signal_variance"]),
        float(words["noise_variance"]),
        array("weights"),
        np.asfortranarray(array("L")),
        array("X"),
        array("y"),
        array("theta"),
    )


def _local(words: Words, array: Lookup) -> LocalPosterior:
    from etude_sparse.local_posterior import local_posterior_given

    return local_posterior_given(
        kernel_of(words["kernel"]),
        array("theta"),
        float(words["noise_variance"]),
        array("centres"),
        array("lengths"),
        int(words["nearest"]),
        (array("X"), array("y"), array("counts")),
    )


LWPR_ARRAYS = ("c", "x0", "F", "level", "slope", "spread", "residual")


def _lwpr(words: Words, array: Lookup) -> LWPRPosterior:
    from etude_sparse.lwpr.posterior import LWPRPosterior

    return LWPRPosterior(
        float(words["noise_variance"]),
        float(words["signal_variance"]),
        *(array(name) for name in LWPR_ARRAYS),
    )


SPECTRUM = Form(
    ("weights", "L", "X", "y", "theta", "frequencies"), ("noise_variance", "signal_variance"), _spectrum
)
LOCAL = Form(("theta", "centres", "lengths", "X", "y", "counts"), ("noise_variance", "nearest"), _local)
LWPR = Form(LWPR_ARRAYS, ("noise_variance", "signal_variance"), _lwpr)
