"""The part of `etude bench gp` beside other libraries: the same data, kernel, hyperparameters and thread.

A peer is first asked for the value and gradient at Étude's hyperparameters; one that disagrees is reported
and not timed. Then both evaluate in turn, each time at slightly other hyperparameters, as a training would,
so that nothing that is kept from one evaluation to the next is mistaken for speed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from etude.models import ExactGP
from etude.types import Array
from etude_sparse import SparseSpectrumGP, initial_sparse_spectrum
from etude_studies.peers.catalogue import Peer
from etude_studies.peers.running import PeerUnavailable, Running, Timed, started
from etude_studies.peers.worker import timed
from etude_studies.rows import Row

Evaluate = Callable[[Array], Timed]

REPEATS: Mapping[int, int] = {500: 30, 1000: 12, 3000: 5}
QUICK = 1000
"""The largest n of the shorter form."""
SPECTRAL_POINTS, SPECTRAL_SAMPLES, SPECTRAL_REPEATS = 200, 3000, 20
TOLERANCE = 1e-6
"""Relative, of value and gradient. GPy adds 1e-8 to the noise variance and gpflash a nugget: 1e-9 to 1e-7."""
STEP = 1e-3
"""How far the log hyperparameters move from one evaluation to the next."""
INSTALL = (
    "For its rows: pip install './packages/etude-studies[bench]', or --python with the interpreter of "
    "another environment"
)


def peer_rows(
    problems: Mapping[int, tuple[ExactGP, Array, Array]], peers: Sequence[Peer], pythons: Sequence[Path] = ()
) -> list[Row]:
    """Agreement and time of each peer on each of the problems n -> process, X (n, D), y (n,).

    A peer that cannot be had, or fails, is left out from there on, with a message on stderr.
    """
    rows = []
    for peer in peers:
        for n, (gp, X, y) in problems.items():
            try:
                with started(peer, X, y, pythons) as running:
                    rows += _compared(f"n{n}_{peer.name}", gp, X, y, running, REPEATS.get(n, 1))
            except PeerUnavailable as reason:
                _say(f"{peer.title} is left out from n = {n} on ({reason.fact}). {INSTALL}.")
                break
    return rows


def spectrum_rows(
    inputs: int, rng: np.random.Generator, peer: Peer, pythons: Sequence[Path] = ()
) -> list[Row]:
    """Likelihood and gradient of a sparse spectrum with learned points, beside autograd of the same formula.

    Without torch the row has no reference, and a message says so.
    """
    X, y = rng.uniform(-1.0, 1.0, size=(SPECTRAL_SAMPLES, inputs)), rng.normal(size=SPECTRAL_SAMPLES)
    gp = initial_sparse_spectrum(X, y, SPECTRAL_POINTS, rng, draws=1, learned=True)
    ending = f"m{SPECTRAL_POINTS}_n{SPECTRAL_SAMPLES}"
    name, evaluate = f"ssgp_nlml_gradient_{ending}", _objective(gp, X, y)
    try:
        with started(peer, X, y, pythons) as running:
            agreement = _agreement(f"ssgp_agreement_{ending}", gp.parameters, evaluate, running)
            if _disagrees(agreement, running.described):
                return [agreement, _alone(name, evaluate, gp.parameters)]
            ours, theirs = in_turn([evaluate, running.evaluate], gp.parameters, SPECTRAL_REPEATS)
            return [agreement, Row(name, ours, "ms", f"in turn, {running.described}", theirs)]
    except PeerUnavailable as reason:
        _say(f"the sparse spectrum has no {peer.title} beside it ({reason.fact}). {INSTALL}.")
        return [_alone(name, evaluate, gp.parameters)]


def in_turn(evaluates: Sequence[Evaluate], parameters: Array, repeats: int) -> list[float]:
    """Median times of objectives evaluated in turn, in ms, on one thread, each round at other parameters."""
    with threadpool_limits(limits=1):  # here, as the libraries of all peers are loaded by now
        times = [[evaluate(parameters + STEP * (1 + i))[2] for evaluate in evaluates] for i in range(repeats)]
    return [float(time) for time in 1e3 * np.median(times, axis=0)]


def _compared(ending: str, gp: ExactGP, X: Array, y: Array, running: Running, repeats: int) -> list[Row]:
    evaluate = _objective(gp, X, y)
    agreement = _agreement(f"nlml_agreement_{ending}", gp.parameters, evaluate, running)
    if _disagrees(agreement, running.described):
        return [agreement]
    theirs, ours = in_turn([running.evaluate, evaluate], gp.parameters, repeats)
    described = f"Étude, in turn; {running.described}"
    return [agreement, Row(f"nlml_gradient_{ending}", theirs, "ms", described, ours)]


def _alone(metric: str, evaluate: Evaluate, parameters: Array) -> Row:
    evaluate(parameters)
    (value,) = in_turn([evaluate], parameters, SPECTRAL_REPEATS)
    return Row(metric, value, "ms")


def _objective(gp: ExactGP | SparseSpectrumGP, X: Array, y: Array) -> Evaluate:
    def objective(parameters: Array) -> tuple[float, Array]:
        value, gradient = gp.with_parameters(parameters).log_marginal_likelihood(X, y)
        return -value, -gradient

    return lambda parameters: timed(objective, parameters)


def _agreement(metric: str, parameters: Array, evaluate: Evaluate, running: Running) -> Row:
    """Largest relative difference, of the values and of the gradients; it is both sides' warm-up as well."""
    with threadpool_limits(limits=1):
        value, gradient, _ = evaluate(parameters)
        theirs, their_gradient, _ = running.evaluate(parameters)
    off = np.inf
    if np.shape(their_gradient) == gradient.shape:
        differences = np.append(their_gradient - gradient, 0.0) / np.abs(gradient).max()
        differences[-1] = (theirs - value) / abs(value)
        off = float(np.abs(differences).max())  # NaN if any is
    return Row(metric, off, "1", f"tolerance; {running.described}", TOLERANCE)


def _disagrees(agreement: Row, described: str) -> bool:
    """Whether it does, after a message; NaN disagrees."""
    if agreement.value <= TOLERANCE:
        return False
    _say(f"{described} disagrees by {agreement.value:.2g} ({agreement.metric}) and is not timed.")
    return True


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)  # noqa: T201
