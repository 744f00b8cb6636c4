"""Regressors that the thesis does not have: a neural network, random Fourier features, boosted trees.

Each learns commands Y (n, J) of inputs X (n, D). What networks and trees leave open is tuned on the same
samples: settings are drawn at random (Bergstra and Bengio 2012), and the one with the least squared error on
trajectories that are left out, every other of them at a time, is trained on all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from etude.types import Array, Index

Predict = Callable[[Array], Array]
Weights = list[tuple[NDArray[Any], NDArray[Any]]]
Drawn = TypeVar("Drawn")
Fit = Callable[[Drawn, Array, Array, np.random.Generator], Predict]
"""From a setting, X (n, D) and Y (n, J) to what predicts (m, J) at (m, D)."""

FOLDS = 2
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Units:
    """Mean and deviation of each column; 1 where a column does not change."""

    mean: Array
    deviation: Array

    @classmethod
    def of(cls, columns: Array) -> Units:
        """Of columns (n, D)."""
        deviation = columns.std(axis=0)
        return cls(columns.mean(axis=0), np.where(deviation > TINY, deviation, 1.0))

    def removed(self, columns: Array) -> Array:
        """Standardised (n, D)."""
        return np.asarray((columns - self.mean) / self.deviation)

    def restored(self, columns: Array) -> Array:
        """Of standardised columns (n, D)."""
        return np.asarray(self.mean + self.deviation * columns)


def standardised(fit: Fit[Drawn]) -> Fit[Drawn]:
    """The same in standard units of X and Y."""

    def fitted(setting: Drawn, X: Array, Y: Array, rng: np.random.Generator) -> Predict:
        inputs, outputs = Units.of(X), Units.of(Y)
        predict = fit(setting, inputs.removed(X), outputs.removed(Y), rng)
        return lambda new: outputs.restored(predict(inputs.removed(new)))

    return fitted


def best_of(
    fit: Fit[Drawn],
    settings: Sequence[Drawn],
    X: Array,
    Y: Array,
    group: Index,
    rng: np.random.Generator,
) -> Predict:
    """Fitted with the setting of least error on groups left out, every `FOLDS`-th at a time.

    A group alone is cut into `FOLDS` pieces of time.
    """
    groups, place = np.unique(group, return_inverse=True)
    fold = place % FOLDS if len(groups) >= FOLDS else np.arange(len(X)) * FOLDS // len(X)
    seed = int(rng.integers(2**32))  # settings differ in nothing else
    spread = Units.of(Y).deviation

    def error(setting: Drawn) -> float:
        total = 0.0
        for out in range(FOLDS):
            training, test = fold != out, fold == out
            fitted = fit(setting, X[training], Y[training], np.random.default_rng(seed))
            total += float(np.sum(((fitted(X[test]) - Y[test]) / spread) ** 2))
        return total

    best = settings[int(np.argmin([error(setting) for setting in settings]))]
    return fit(best, X, Y, np.random.default_rng(seed))


@dataclass(frozen=True)
class NetworkSetting:
    """width: of two hidden layers. rate: first step of Adam, which ends at 0. decay: penalty on squares."""

    width: int
    rate: float
    decay: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> NetworkSetting:
        """Width 32, 64 or 128; rate and decay uniform in their logarithms."""
        rate, decay = 10.0 ** rng.uniform([-3.0, -6.0], [-1.7, -2.0])
        return cls(int(rng.choice([32, 64, 128])), float(rate), float(decay))


EPOCHS, BATCH = 150, 100
FORGETS, FORGETS_SQUARES, DIVISOR = 0.9, 0.999, 1e-8
"""Of Adam, as Kingma and Ba (2015) give them."""


def network(setting: NetworkSetting, X: Array, Y: Array, rng: np.random.Generator) -> Predict:
    """Two hidden layers of tanh for all commands together, by Adam in single precision."""
    X, Y = X.astype(np.float32), Y.astype(np.float32)
    weights = first_weights((X.shape[1], setting.width, setting.width, Y.shape[1]), rng)

    def slopes(rows: Index) -> Sequence[NDArray[Any]]:
        _, gradient = loss_gradient(weights, X[rows], Y[rows], setting.decay)
        return [part for layer in gradient for part in layer]

    by_adam([part for layer in weights for part in layer], slopes, len(X), setting.rate, rng)
    return lambda new: layers(weights, new.astype(np.float32))[-1].astype(float)


def by_adam(
    values: Sequence[NDArray[Any]],
    slopes: Callable[[Index], Sequence[NDArray[Any]]],
    count: int,
    rate: float,
    rng: np.random.Generator,
) -> None:
    """Changes `values` by `EPOCHS` of Adam in batches of `BATCH` of `count` samples; steps fall to 0 as a
    cosine (Loshchilov and Hutter 2017).

    Args:
        slopes: gradient of each of the values at samples of these numbers.
    """
    means, squares = ([np.zeros_like(w) for w in values] for _ in range(2))
    batches = max(1, count // BATCH)
    steps, t = EPOCHS * batches, 0
    for _ in range(EPOCHS):
        for batch in np.array_split(rng.permutation(count), batches):
            gradient = slopes(batch)
            t += 1
            now = 0.5 * rate * (1.0 + np.cos(np.pi * t / steps))
            now *= np.sqrt(1.0 - FORGETS_SQUARES**t) / (1.0 - FORGETS**t)
            for w, g, m, s in zip(values, gradient, means, squares, strict=True):
                m += (1.0 - FORGETS) * (g - m)
                s += (1.0 - FORGETS_SQUARES) * (g * g - s)
                w -= w.dtype.type(now) * m / (np.sqrt(s) + DIVISOR)


def first_weights(sizes: Sequence[int], rng: np.random.Generator) -> Weights:
    """Of each layer (in, out) and (out,), by Glorot and Bengio (2010)."""
    drawn = (rng.normal(0.0, np.sqrt(2.0 / (i + o)), (i, o)).astype(np.float32) for i, o in pairwise(sizes))
    return [(W, np.zeros(W.shape[1], dtype=np.float32)) for W in drawn]


def layers(weights: Weights, X: NDArray[Any]) -> list[NDArray[Any]]:
    """Inputs, what each hidden layer gives, and outputs."""
    outputs = [X]
    for place, (W, b) in enumerate(weights, start=1):
        value = outputs[-1] @ W + b
        outputs.append(np.tanh(value) if place < len(weights) else value)
    return outputs


def loss_gradient(weights: Weights, X: NDArray[Any], Y: NDArray[Any], decay: float) -> tuple[float, Weights]:
    """Half the mean squared error plus half the decay of all matrices, and its gradient."""
    values = layers(weights, X)
    wrong = values[-1] - Y
    loss = 0.5 * float(np.mean(wrong**2)) + 0.5 * decay * sum(float(np.sum(W**2)) for W, _ in weights)
    slope, gradients = wrong / wrong.size, []
    for (W, _), below in zip(reversed(weights), reversed(values[:-1]), strict=True):
        gradients.append((below.T @ slope + decay * W, slope.sum(axis=0)))
        slope = (slope @ W.T) * (1.0 - below**2)
    return loss, gradients[::-1]


def orthogonal(rows: int, columns: int, rng: np.random.Generator) -> Array:
    """(rows, columns) frequencies of a unit squared exponential, orthogonal in blocks (Yu et al. 2016).

    Directions of a block are those of a random rotation; sizes are those of normal vectors.
    """
    blocks = -(-rows // columns)
    turns = [np.linalg.qr(rng.normal(size=(columns, columns)))[0] for _ in range(blocks)]
    sizes = np.sqrt(rng.chisquare(columns, rows))
    return np.asarray(np.concatenate(turns)[:rows] * sizes[:, None])


def independent(rows: int, columns: int, rng: np.random.Generator) -> Array:
    """(rows, columns) frequencies drawn one by one (Rahimi and Recht 2007)."""
    return rng.normal(size=(rows, columns))


def features(W: Array, lengths: Array, X: Array, y: Array, ridge: float) -> Predict:
    """Ridge regression of y (n,) on cosine and sine of frequencies W (m, D) over the lengths (D,).

    It is the mean of a process with that squared exponential, as far as the frequencies approximate it.

    Args:
        ridge: variance of the noise over that of the signal.
    """
    turned = (W / lengths).T

    def basis(Z: Array) -> Array:
        angle = Z @ turned
        return np.asarray(np.concatenate([np.cos(angle), np.sin(angle)], axis=1) / np.sqrt(len(W)))

    F = basis(X)
    gram = F.T @ F
    gram[np.diag_indices_from(gram)] += ridge
    weights = cho_solve(cho_factor(gram, lower=True), F.T @ y)
    return lambda new: np.asarray(basis(new) @ weights)


@dataclass(frozen=True)
class TreeSetting:
    """depth: of each tree. rate: part of a tree that counts. least: samples in a leaf."""

    depth: int
    rate: float
    least: int

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> TreeSetting:
        """Depth 2 to 6, rate 0.03 to 0.3, 5 to 40 samples."""
        rate = float(10.0 ** rng.uniform(-1.5, -0.5))
        return cls(int(rng.integers(2, 7)), rate, int(rng.integers(5, 41)))


TREES, BINS = 200, 32


@dataclass(frozen=True, eq=False)
class Tree:
    """A whole binary tree, level after level.

    Attributes:
        column, cut: of each inner node; a sample goes right where its bin is above the cut. value: of leaves.
    """

    column: Index
    cut: Index
    value: Array

    def predict(self, bins: Index) -> Array:
        """(n,) of samples (n, D) in bins."""
        node, rows = np.zeros(len(bins), dtype=np.int64), np.arange(len(bins))
        for _ in range(int(np.log2(len(self.value)))):
            node = 2 * node + 1 + (bins[rows, self.column[node]] > self.cut[node])
        return np.asarray(self.value[node - len(self.column)])


def boosted(setting: TreeSetting, X: Array, Y: Array, rng: np.random.Generator) -> Predict:  # noqa: ARG001
    """`TREES` trees on histograms for each command, each on what those before it leave (Friedman 2001)."""
    edges = np.quantile(X, np.arange(1, BINS) / BINS, axis=0)

    def binned(Z: Array) -> Index:
        return np.stack([np.searchsorted(edges[:, d], Z[:, d]) for d in range(Z.shape[1])], axis=1)

    bins, trees = binned(X), []
    for left in Y.T.copy():
        ensemble = []
        for _ in range(TREES):
            ensemble.append(grown(setting, bins, left))
            left -= setting.rate * ensemble[-1].predict(bins)
        trees.append(ensemble)

    def predict(new: Array) -> Array:
        places = binned(new)
        sums = [sum((tree.predict(places) for tree in ensemble), np.zeros(len(new))) for ensemble in trees]
        return np.asarray(setting.rate * np.stack(sums, axis=1))

    return predict


def grown(setting: TreeSetting, bins: Index, y: Array) -> Tree:
    """The tree that lessens the squared error of y (n,) most at every cut; `bins` (n, D)."""
    n, D = bins.shape
    inner = 2**setting.depth - 1
    column, cut = np.zeros(inner, dtype=np.int64), np.full(inner, BINS, dtype=np.int64)
    node, rows = np.zeros(n, dtype=np.int64), np.arange(n)
    weights = np.repeat(y, D)
    for level in range(setting.depth):
        nodes, first = 2**level, 2**level - 1
        place = (((node - first)[:, None] * D + np.arange(D)) * BINS + bins).ravel()
        counts = np.bincount(place, minlength=nodes * D * BINS).reshape(nodes, D, BINS).cumsum(axis=2)
        sums = np.bincount(place, weights, nodes * D * BINS).reshape(nodes, D, BINS).cumsum(axis=2)
        c, s, count, total = counts[..., :-1], sums[..., :-1], counts[..., -1:], sums[..., -1:]
        fair = (c >= setting.least) & (count - c >= setting.least)
        gain = s**2 / np.maximum(c, 1) + (total - s) ** 2 / np.maximum(count - c, 1)
        gain = np.where(fair, gain, -np.inf).reshape(nodes, -1)
        best = gain.argmax(axis=1)
        there = np.isfinite(gain[np.arange(nodes), best])  # a node without a fair cut sends all to the left
        column[first : first + nodes] = best // (BINS - 1)
        cut[first : first + nodes] = np.where(there, best % (BINS - 1), BINS)
        node = 2 * node + 1 + (bins[rows, column[node]] > cut[node])
    leaf = node - inner
    count = np.maximum(np.bincount(leaf, minlength=inner + 1), 1)
    return Tree(column, cut, np.bincount(leaf, y, inner + 1) / count)
