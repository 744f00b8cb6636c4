"""How long signals remember: neighbouring rows of a log are no independent samples."""

from __future__ import annotations

import numpy as np

from etude.types import Array


def memory(values: Array, step: float) -> Array:
    """(k,) s between independent samples of signals (n, k) that are `step` s apart: the integral of the
    autocorrelation over both sides, up to where it first crosses zero (Geyer 1992); `step` of a constant.
    """
    n = len(values)
    spectrum = np.fft.rfft(values - values.mean(axis=0), 2 * n, axis=0)
    products = np.fft.irfft(np.abs(spectrum) ** 2, 2 * n, axis=0)[:n]
    likeness = products / np.maximum(products[0], np.finfo(float).tiny)
    until = np.cumprod(likeness > 0.0, axis=0)
    return np.asarray(step * np.maximum(1.0, 2.0 * (likeness * until).sum(axis=0) - 1.0))
