"""Peers made for tests: adapters of a numpy-only exact process, good and bad."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from etude_studies.peers.catalogue import Peer

DENSE = """
import os
import numpy as np

NOTE = "made for a test"
print("a library may print when it is imported")


def objective(X, y):
    squares = (X[:, None, :] - X[None, :, :]) ** 2

    def evaluate(parameters):
        print("or when it computes")
        lengths, noise = np.exp(parameters[1:-1]), np.exp(2 * parameters[-1])
        scaled = squares / lengths**2
        K = np.exp(2 * parameters[0] - 0.5 * scaled.sum(axis=2))
        Ky = K + noise * np.eye(len(y))
        W = np.linalg.inv(Ky)
        alpha = W @ y
        value = 0.5 * (y @ alpha + np.linalg.slogdet(Ky)[1] + len(y) * np.log(2 * np.pi))
        Q = W - np.outer(alpha, alpha)
        along = [0.5 * (Q * K * scaled[:, :, d]).sum() for d in range(X.shape[1])]
        gradient = np.array([(Q * K).sum(), *along, noise * np.trace(Q)])
        AFTERWARDS
        return value, gradient

    return evaluate
"""
SPECTRAL = """
from etude_sparse.sparse_spectrum import SparseSpectrumGP

NOTE = ""


def objective(X, y):
    D = X.shape[1]

    def evaluate(parameters):
        points = parameters[D + 2 :].reshape(-1, D)
        gp = SparseSpectrumGP(points, parameters[: D + 1], parameters[D + 1], learned=True)
        value, gradient = gp.log_marginal_likelihood(X, y)
        return -value, -gradient

    return evaluate
"""

MakePeer = Callable[..., Peer]


def peer_maker(folder: Path) -> MakePeer:
    """A function that writes an adapter, `afterwards` in its last lines, and gives the peer."""

    def make(name: str = "dense", *, afterwards: str = "pass", code: str = DENSE) -> Peer:
        file = folder / f"{name}.py"
        file.write_text(code.replace("AFTERWARDS", afterwards), encoding="utf-8")
        return Peer(name, name.capitalize(), "numpy", file)

    return make
