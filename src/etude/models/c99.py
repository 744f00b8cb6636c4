"""C99 export of processes: the code generator for each form of posterior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from etude.models.gp.basis_posterior import BasisPosterior
from etude.models.gp.c99 import UnwritableError, expanded, greedy_order, merged_functions, real
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.plugin_kernel import in_parts
from etude.models.process_abilities import SupportsC
from etude.protocols import Posterior
from etude.types import Array, Code, Column


def posteriors_code(name: str, posteriors: Sequence[Posterior]) -> Code:
    """One function for a posterior of each output; those of one factor share their covariances.

    Raises:
        UnwritableError: a posterior or a part of a kernel has no C.
    """
    groups: dict[int, list[int]] = {}
    for place, posterior in enumerate(posteriors):
        shared = posterior.L if isinstance(posterior, ExactPosterior) else posterior
        groups.setdefault(id(shared), []).append(place)
    parts = []
    for number, places in enumerate(groups.values()):
        function = f"{name}_{number}"
        parts.append((_group(function, [posteriors[place] for place in places]), function, tuple(places)))
    return merged_functions(name, parts)


def _group(name: str, posteriors: Sequence[Any]) -> Code:
    first = posteriors[0]
    if isinstance(first, ExactPosterior):
        weights = np.stack([posterior.alpha for posterior in posteriors])
        order, factor = greedy_order(first.L)
        return expanded(name, in_parts(first.kernel), first.theta, first.X, weights, factor, order)
    if isinstance(first, BasisPosterior):
        weights = first.weights[None]
        return expanded(name, in_parts(first.kernel), first.theta, first.basis, weights, first.half)
    if isinstance(first, SupportsC):
        return first.c(name)
    raise UnwritableError(f"a process of the form {type(first).__name__}")


def silent_code(name: str, silent: Any) -> Code:
    """A mean of zero, and the variance of `process.Silent`."""
    m = len(silent.least)
    grows = silent.grows and silent.own is not None
    inner: Code | None = silent.own.c(f"{name}_own") if grows else None
    lines = [f"    mean[{j}] = R(0.0);" for j in range(m)]
    lines += ["    if (variance) {"]
    if grows:
        pairs = enumerate(zip(silent.calibration, silent.own.noise_variance, strict=True))
        lines += [
            f"        variance[{j}] = variance[{j}] / {real(f)} - {real(s)};" for j, (f, s) in pairs if f
        ]
        lines += [f"        {name}_own(x, own, variance);"]
    for j, least in enumerate(silent.least):
        if grows:
            noise, factor = silent.own.noise_variance[j], silent.calibration[j]
            lines += [f"        variance[{j}] = {real(factor)} * (variance[{j}] + {real(noise)});"]
            lines += [f"        if (variance[{j}] < {real(least)}) variance[{j}] = {real(least)};"]
        else:
            lines += [f"        variance[{j}] = {real(least)};"]
    lines += ["    }"]
    head = f"static void {name}(const real *x, real *mean, real *variance)\n{{"
    guard = ["#if VARIANCE", f"    real own[{m}];", "#endif"] if grows else ["    (void)x;"]
    if inner is not None:
        lines = [
            *lines[:m],
            "#if VARIANCE",
            *lines[m:],
            "#else",
            "    (void)x;",
            "    (void)variance;",
            "#endif",
        ]
        body = "\n".join(["#if VARIANCE", inner.body, "#endif", head, *guard, *lines, "}", ""])
        every = {**inner.data, **inner.variance}
        return Code(body, {}, every, work=inner.work + m, operations=(m, sum(inner.operations)))
    return Code("\n".join([head, *guard, *lines, "}", ""]), {}, operations=(m, m))


def mean_function(
    name: str, reads: Sequence[str], lines: Sequence[str], static: Sequence[str] = (), memory: bool = False
) -> str:
    """`name` and `name_static` of a mean: statements that set command[j] from the channels c_NAME.

    Args:
        static: statements of the second; none: the first's, whose caller puts rates to zero.
        memory: the first has one, `memory`, and the second statements of its own.
    """
    channels = [f"const real *c_{channel}" for channel in reads]
    arguments = ", ".join([*channels, "real *command"])
    remembering = ", ".join([*channels, *["real *memory"] * memory, "real *command"])
    passed = ", ".join([*(f"c_{channel}" for channel in reads), "command"])
    still = static or [f"    {name}({passed});"]
    one = [f"static void {name}({remembering})", "{", *lines, "}", ""]
    other = [f"static void {name}_static({arguments})", "{", *still, "}", ""]
    return "\n".join([*one, *other])


def linear_code(name: str, columns: Sequence[Column], weights: Array) -> Code:
    """Linear regression: weights (F + 1, J) of the columns without an op, and of the constant."""
    used: dict[str, int] = {}
    terms = []
    for channel, _, _, op in columns:
        if not op:
            terms.append(f"c_{channel}[{used.get(channel, 0)}]")
            used[channel] = used.get(channel, 0) + 1
    lines = []
    for j, column in enumerate(weights.T):
        parts = [f"{real(w)} * {term}" for w, term in zip(column, terms, strict=False)]
        lines.append(f"    command[{j}] = {' + '.join([real(column[-1]), *parts])};")
    body = mean_function(name, tuple(used), lines)
    return Code(body, {}, reads=tuple(used), operations=(2 * weights.size, 0))
