"""Catalogue of peers: one row each. A peer is one file with one function, `objective`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Peer:
    """A library that computes a likelihood which Étude computes too.

    Attributes:
        name: in the names of rows. title: for people. distribution: what pip installs.
        file: its adapter, which imports numpy and the library alone, so that the interpreter of another
            environment can run it. It has `NOTE`, what to know about the computation, and
            `objective(X, y)`, which returns a function of Étude's parameters (logarithms; P,) that gives
            the negative log marginal likelihood of y (n,) at X (n, D) and its gradient (P,).
    """

    name: str
    title: str
    distribution: str
    file: Path


EXACT = (
    Peer("sklearn", "scikit-learn", "scikit-learn", FOLDER / "exact_sklearn.py"),
    Peer("gpy", "GPy", "GPy", FOLDER / "exact_gpy.py"),
    Peer("gpytorch", "GPyTorch", "gpytorch", FOLDER / "exact_gpytorch.py"),
    Peer("gpflash", "gpflash", "gpflash", FOLDER / "exact_gpflash.py"),
)
"""Exact processes with a squared exponential of all inputs: log s0, log ℓ_1 .. log ℓ_D, log sn."""
SPECTRUM = Peer("torch", "torch", "torch", FOLDER / "spectrum_torch.py")
"""A sparse spectrum process: the same, then the spectral points row by row."""
