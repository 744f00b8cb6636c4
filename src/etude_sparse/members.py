"""Members that no default uses, and how their posteriors are stored: dictionaries, spectra, local models.

Each is a row of the plug-in table (`etude.models`), as another package's member would be.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from etude.models.data.fit_data import (
    columns,
    complete_samples,
    initial_process,
    previous_process,
    trained_process,
    weak,
)
from etude.models.forms import Form, Lookup, Metadata, kernel_of
from etude.models.members import BuiltIn, each_output, guides, shared_outputs
from etude.models.process import Posteriors, Teaching
from etude.protocols import FitData, Posterior
from etude.types import Array
from etude_sparse.thesis_dictionary import thesis_dictionary

if TYPE_CHECKING:  # a campaign loads only the member that it uses
    from etude_sparse.local_posterior import LocalPosterior
    from etude_sparse.lwpr.posterior import LWPRPosterior
    from etude_sparse.sparse_spectrum import SparseSpectrumGP
    from etude_sparse.spectral_posterior import SparseSpectrumPosterior


def _dictionary(rule: Literal["variance", "error"], fit: FitData) -> Teaching:
    """Exact regression on `points` samples: evenly spread ones, improved by offering every other.

    Hyperparameters come from the chosen samples, not from the members. The error rule picks members for their
    errors, so noise trained on them is too large.
    """
    from etude_sparse.dictionary import DictionaryConfig, DictionaryGP

    points = fit.config.points
    gp = DictionaryGP(trained_process(fit), DictionaryConfig(size=points, rule=rule))

    def condition(X: Array, y: Array) -> Posterior:
        count = min(points, len(y))
        return gp.select(X, y, start=np.arange(count) * len(y) // count).posterior

    return Teaching(fit, each_output(condition), complete_samples(fit))


def _thesis(rule: Literal["variance", "error"], fit: FitData) -> Teaching:
    """The dictionary as the thesis has it, carried from log to log."""
    gp, members = thesis_dictionary(rule, fit)
    return Teaching(fit, shared_outputs(gp), members)


def _ssgp_fixed(fit: FitData) -> Teaching:
    """A sparse spectrum with the likeliest of 100 draws of its points, or with those of the earlier one."""
    return Teaching(fit, each_output(_spectrum(fit).condition), complete_samples(fit))


def _ssgp_learned(fit: FitData) -> Teaching:
    """A sparse spectrum whose points are learned, until the newest trajectory is predicted no better.

    Without a prior, by maximum likelihood over points and hyperparameters at once, as the thesis: no guard.
    """
    from etude_sparse.sparse_spectrum_training import fit_sparse_spectrum

    config, rows = fit.config, fit.chosen
    X, Y, group = fit.X[rows], fit.Y[rows], fit.group[rows]
    train = partial(fit_sparse_spectrum, method=config.method, steps=config.steps)
    if config.prior == "none":
        drawn = replace(_drawn_spectrum(fit), learned=True)
        gp = train(drawn, X, columns(Y), prior=None, point_prior=False)
        return Teaching(fit, each_output(gp.condition), complete_samples(fit))
    newest = group == group.max()
    held_out = None if newest.all() else (X[newest], columns(Y[newest]))
    training = np.ones_like(newest) if held_out is None else ~newest
    start = replace(_spectrum(fit), learned=True)
    gp = train(start, X[training], columns(Y[training]), prior="weak", held_out=held_out)
    return Teaching(fit, each_output(gp.condition), complete_samples(fit))


def _spectrum(fit: FitData) -> SparseSpectrumGP:
    """Points that stay, and the hyperparameters found with them."""
    from etude_sparse.sparse_spectrum_training import fit_sparse_spectrum

    config, X, y = fit.config, fit.X[fit.chosen], columns(fit.Y[fit.chosen])
    gp, prior = _drawn_spectrum(fit), weak(fit, X, y)
    return fit_sparse_spectrum(gp, X, y, method=config.method, steps=config.steps, prior=prior)


def _drawn_spectrum(fit: FitData) -> SparseSpectrumGP:
    """The earlier points if there are as many, else the likeliest of 100 draws, as the authors' code."""
    from etude_sparse.sparse_spectrum import SparseSpectrumGP
    from etude_sparse.sparse_spectrum_training import redrawn
    from etude_sparse.spectral_posterior import SparseSpectrumPosterior

    gp, earlier, shape = initial_process(fit), previous_process(fit), (fit.config.basis, fit.X.shape[1])
    start = earlier.own[0] if isinstance(earlier, Posteriors) else None
    if isinstance(start, SparseSpectrumPosterior) and start.points.shape == shape:
        return SparseSpectrumGP(start.points, gp.theta, gp.log_noise, gp.noise_floor)
    blank = SparseSpectrumGP(np.zeros(shape), gp.theta, gp.log_noise, gp.noise_floor)
    return redrawn(blank, fit.X[fit.chosen], columns(fit.Y[fit.chosen]), fit.rng)


def _sogp(fit: FitData) -> Teaching:
    """The sparse online process, sample by sample through those kept, with an exact process's parameters."""
    from etude_sparse.sogp import SOGP

    gp = trained_process(fit)
    online = SOGP(gp.kernel, gp.theta, gp.log_noise, gp.noise_floor, capacity=fit.config.basis)
    return Teaching(fit, each_output(online.condition), fit.kept)


def _local_gp(fit: FitData) -> Teaching:
    """Local processes of `points` samples each, with an exact process's parameters; that process guides."""
    from etude_sparse.local import LocalGP

    gp = trained_process(fit)
    member = LocalGP(gp, capacity=fit.config.points)
    return Teaching(fit, each_output(member.condition), complete_samples(fit), guides(gp, fit))


def _lwpr(fit: FitData) -> Teaching:
    """Receptive fields on every sample that counts; an exact process is trained beside them, to guide."""
    from etude_sparse.lwpr.regression import LWPR

    member = LWPR(noise_floor=float(fit.floor.max()))
    return Teaching(
        fit, each_output(member.condition), complete_samples(fit), guides(trained_process(fit), fit)
    )


dictionary_variance = BuiltIn(partial(_dictionary, "variance"))
dictionary_error = BuiltIn(partial(_dictionary, "error"))
thesis_dictionary_variance = BuiltIn(partial(_thesis, "variance"))
thesis_dictionary_error = BuiltIn(partial(_thesis, "error"))
ssgp_fixed = BuiltIn(_ssgp_fixed)
ssgp_learned = BuiltIn(_ssgp_learned)
sogp = BuiltIn(_sogp)
local_gp = BuiltIn(_local_gp)
lwpr = BuiltIn(_lwpr)


def _read_spectrum(metadata: Metadata, array: Lookup) -> SparseSpectrumPosterior:
    from etude_sparse.spectral_posterior import SparseSpectrumPosterior, SpectralFeatures

    return SparseSpectrumPosterior(
        SpectralFeatures(array("frequencies")),
        float(metadata["signal_variance"]),
        float(metadata["noise_variance"]),
        array("weights"),
        np.asfortranarray(array("L")),
        array("X"),
        array("y"),
        array("theta"),
    )


def _local(metadata: Metadata, array: Lookup) -> LocalPosterior:
    from etude_sparse.local_posterior import local_posterior_given

    return local_posterior_given(
        kernel_of(metadata["kernel"]),
        array("theta"),
        float(metadata["noise_variance"]),
        array("centres"),
        array("lengths"),
        int(metadata["nearest"]),
        (array("X"), array("y"), array("counts")),
    )


LWPR_ARRAYS = ("c", "x0", "F", "level", "slope", "spread", "residual")


def _read_lwpr(metadata: Metadata, array: Lookup) -> LWPRPosterior:
    from etude_sparse.lwpr.posterior import LWPRPosterior

    return LWPRPosterior(
        float(metadata["noise_variance"]),
        float(metadata["signal_variance"]),
        *(array(name) for name in LWPR_ARRAYS),
    )


SPECTRUM = Form(
    ("weights", "L", "X", "y", "theta", "frequencies"), ("noise_variance", "signal_variance"), _read_spectrum
)
LOCAL = Form(("theta", "centres", "lengths", "X", "y", "counts"), ("noise_variance", "nearest"), _local)
LWPR = Form(LWPR_ARRAYS, ("noise_variance", "signal_variance"), _read_lwpr)
