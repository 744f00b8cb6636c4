"""Processes as operators of ONNX: means and latent variances (n, m) of inputs x (n, D)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from etude.deploy.onnx.graph import Graph
from etude.deploy.onnx.kernels import covariance, prior, reads, unwritable
from etude.models.gp.basis_posterior import BasisPosterior
from etude.models.gp.exact import ExactPosterior
from etude.models.process import Posteriors, Silent
from etude.models.protocols import SupportsOnnxMoments
from etude.protocols import Process

Moments = tuple[str, str]
"""Mean and variance (n, m); the variance "" where it was not asked for."""


def looked_at(process: Process) -> set[int]:
    """Columns of the inputs that it looks at. UsageError where something in it has no operators."""
    if isinstance(process, Silent):
        return looked_at(process.own) if process.grows and process.own is not None else set()
    if not isinstance(process, Posteriors):
        raise unwritable(f"the process {type(process).__name__}")
    return {column for own in process.own for column in _columns(own)}


def _columns(posterior: Any) -> set[int]:
    if isinstance(posterior, SupportsOnnxMoments):
        return set(posterior.columns_read)
    if isinstance(posterior, ExactPosterior | BasisPosterior):
        return reads(posterior.kernel)
    raise unwritable(f"a process of the form {type(posterior).__name__}")


def moments(graph: Graph, x: str, process: Process, variance: bool) -> Moments:
    """Of any process that `looked_at` lets pass."""
    if isinstance(process, Silent):
        return _silent(graph, x, process, variance)
    assert isinstance(process, Posteriors)
    groups: dict[Any, list[int]] = {}
    for place, own in enumerate(process.own):
        groups.setdefault(_like(own), []).append(place)
    found = [_together(graph, x, [process.own[p] for p in places], variance) for places in groups.values()]
    order = np.argsort([place for places in groups.values() for place in places])
    return in_order(graph, [m for m, _ in found], order), in_order(graph, [v for _, v in found], order)


def _like(posterior: Any) -> Any:
    """Those that are alike are asked at once: a kernel and as many points, or as many frequencies."""
    if isinstance(posterior, SupportsOnnxMoments):
        return type(posterior), posterior.alike
    return posterior.kernel, _points(posterior).shape


def _points(posterior: Any) -> Any:
    return posterior.X if isinstance(posterior, ExactPosterior) else posterior.basis


def in_order(graph: Graph, values: Sequence[str], order: Any) -> str:
    """Columns of several tables as one, in that order; "" where there are none."""
    if not values[0]:
        return ""
    whole = values[0] if len(values) == 1 else graph.op("Concat", *values, axis=1)
    return whole if (order == np.arange(len(order))).all() else graph.columns(whole, order.tolist())


def _together(graph: Graph, x: str, own: Sequence[Any], variance: bool) -> Moments:
    if isinstance(own[0], SupportsOnnxMoments):
        return own[0].onnx_moments(graph, x, own, variance)
    theta, Z = np.stack([p.theta for p in own]), np.stack([_points(p) for p in own])
    k = covariance(graph, x, own[0].kernel, theta, Z)
    weights = np.stack([p.alpha if isinstance(p, ExactPosterior) else p.weights for p in own])
    mean = _mean(graph, k, weights)
    if not variance:
        return mean, ""
    factors = np.stack([p.L_inverse if isinstance(p, ExactPosterior) else p.half for p in own])
    told = _told(graph, k, np.swapaxes(factors, 1, 2))
    left = graph.op("Sub", prior(graph, x, own[0].kernel, theta), told)
    return mean, graph.op("Max", left, np.array(0.0))


def _mean(graph: Graph, k: str, weights: Any) -> str:
    """(n, m) from (m, n, N) and weights (m, N)."""
    columns = graph.total(graph.op("Mul", k, weights[:, None, :]), -1)
    return graph.op("Transpose", columns, perm=[1, 0])


def _told(graph: Graph, k: str, factors: Any) -> str:
    """(n, m) squares |k A|² from (m, n, N) and A (m, N, N)."""
    half = graph.op("MatMul", k, factors)
    return graph.op("Transpose", graph.total(graph.op("Mul", half, half), -1), perm=[1, 0])


def _silent(graph: Graph, x: str, process: Silent, variance: bool) -> Moments:
    zero = graph.op("Mul", graph.columns(x, [0]), np.zeros((1, len(process.least))))
    if not variance:
        return zero, ""
    if not process.grows or process.own is None:
        return zero, graph.op("Add", zero, process.least[None, :])
    _, latent = moments(graph, x, process.own, True)
    noisy = graph.op("Add", latent, process.own.noise_variance[None, :])
    grown = graph.op("Mul", noisy, process.calibration[None, :])
    return zero, graph.op("Max", grown, process.least[None, :])
