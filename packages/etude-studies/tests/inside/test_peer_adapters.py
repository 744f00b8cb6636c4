"""The peers' contract, for those that are installed; the others are skipped."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from etude.models import ExactGP, SquaredExponential
from etude_sparse import SparseSpectrumGP
from etude_studies.bench_peers import TOLERANCE
from etude_studies.peers.catalogue import EXACT, SPECTRUM, Peer
from etude_studies.peers.running import PeerUnavailable, Running, here

RNG = np.random.default_rng(5)
X, Y = RNG.normal(size=(40, 3)), RNG.normal(size=40)
EXACT_START = np.array([0.3, -0.2, 0.4, 1.1, -0.9])
SPECTRUM_START = np.append(EXACT_START, RNG.normal(size=7 * 3))


def ours(peer: Peer, parameters: np.ndarray) -> tuple[float, np.ndarray]:
    theta, log_noise = parameters[:4], float(parameters[4])
    points = parameters[5:].reshape(-1, 3)
    gp = (
        SparseSpectrumGP(points, theta, log_noise, learned=True)
        if peer is SPECTRUM
        else ExactGP(SquaredExponential((0, 1, 2)), theta, log_noise)
    )
    value, gradient = gp.log_marginal_likelihood(X, Y)
    return -value, -gradient


@pytest.fixture(params=[*EXACT, SPECTRUM], ids=lambda peer: peer.title)
def peer(request: pytest.FixtureRequest) -> Peer:
    found: Peer = request.param
    return found


@pytest.fixture
def running(peer: Peer) -> Iterator[Running]:
    place = here(peer, X, Y)
    try:
        found = place.__enter__()
    except PeerUnavailable as reason:
        if "ModuleNotFoundError" not in reason.fact:
            raise
        pytest.skip(f"{peer.title} is not installed: {reason.fact}")
    yield found
    place.__exit__(None, None, None)


def test_value_and_gradient_are_ours_wherever_it_is_asked(peer: Peer, running: Running) -> None:
    start = SPECTRUM_START if peer is SPECTRUM else EXACT_START
    places = [start, start + 0.1 * RNG.normal(size=len(start)), start]  # the first again: nothing is stale
    for parameters in places:
        asked = parameters.copy()
        value, gradient, seconds = running.evaluate(parameters)
        expected, slope = ours(peer, parameters)
        assert value == pytest.approx(expected, rel=TOLERANCE)
        np.testing.assert_allclose(gradient, slope, atol=TOLERANCE * np.abs(slope).max())
        assert seconds > 0.0
        np.testing.assert_array_equal(parameters, asked)


def test_the_figure_says_what_was_computed(peer: Peer, running: Running) -> None:
    assert running.described.startswith(peer.title)
    assert ("Cholesky forced" in running.described) == (peer.name == "gpytorch")


def test_an_adapter_runs_where_etude_is_not_installed(peer: Peer) -> None:
    """It imports the standard library, numpy and its own library, so any interpreter can run it."""
    tree = ast.parse(peer.file.read_text(encoding="utf-8"))
    roots = {
        alias.name.split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    roots |= {
        (node.module or "").split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
    }
    foreign = roots - sys.stdlib_module_names - {"numpy"}
    libraries = {"gpytorch": {"gpytorch", "torch"}, "gpy": {"GPy"}}.get(peer.name, {peer.name})
    assert foreign == libraries
