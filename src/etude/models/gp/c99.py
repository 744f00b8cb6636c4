"""Kernels and posteriors as C99: loops over blocks of points in columns, so that compilers vectorise.

Points are stored as they are, a table for each column, so that outputs with other hyperparameters share them.
A mean skips what is linear in x: the sum over all points is made here, once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.kernel_algebra import Kernel, Product, Sum
from etude.models.gp.kernels import Linear, RestNoise, SquaredExponential
from etude.models.gp.plugin_kernel import PluginKernel
from etude.threads import threads_for
from etude.types import Array, Code, Index

BLOCK = 32
"""As in deploy/targets/c99/prelude.c."""
EXPONENTIAL = 24
"""Operations of one exponential, or of a cosine with its sine half as many again."""
LANE = 16
"""Rows of a triangular table are filled up to whole lanes."""


@runtime_checkable
class BlockKernel(Protocol):
    """A kernel that writes its own C99.

    `c_block(name, theta, Z)`: void name(const real *x, int first, real *k), covariances of x with BLOCK of
    the points Z (n, D), n a multiple of BLOCK, and real name_diagonal(const real *x).
    """

    def c_block(self, name: str, theta: Array, Z: Array) -> Code: ...


@dataclass
class Written:
    """A kernel's C as it grows.

    Attributes:
        name: prefix. Z: (n, D) points, whole blocks. lines: of the loop before the exponentials.
        exponents: how many there are. calls: of kernels with code of their own. body: that code.
    """

    name: str
    Z: Array
    data: dict[str, Any] = field(default_factory=dict)
    columns: set[int] = field(default_factory=set)
    slopes: list[str] = field(default_factory=list)
    exponents: list[str] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    body: list[str] = field(default_factory=list)
    operations: int = 0

    def column(self, d: int) -> str:
        """The points' column d, from the block's first on."""
        self.columns.add(d)
        self.data[f"{self.name}_z{d}"] = self.Z[:, d]
        return f"z{d}"


def real(value: float) -> str:
    """A number in full, as C reads it in any locale, of the type `real`."""
    text = repr(float(value))
    return f"R({text if any(c in text for c in '.en') else text + '.0'})"


def expanded(
    name: str,
    kernel: Kernel,
    theta: Array,
    X: Array,
    weights: Array,
    factor: Array | None,
    order: Index | None = None,
) -> Code:
    """Means Σ_i w_i k(x, x_i) of outputs with one kernel, and their latent variance k(x, x) - |A k|².

    Args:
        name: of the function. weights: (m, n). factor: (n, n) lower triangular A. order: (n,) of the points
            that
            its rows are of; None: their own.

    Raises:
        UnwritableError: a part of the kernel has no C.
    """
    m, n = weights.shape
    size = -(-n // BLOCK) * BLOCK
    Z = np.concatenate([X, np.tile(X[-1:], (size - n, 1))])
    curved, linear = _without_linear(kernel, theta)
    blocks = Written(name, Z)
    value = (
        expression(blocks, Sum(tuple(k for k, _ in curved)), np.concatenate([t for _, t in curved]))
        if curved
        else ""
    )
    data: dict[str, Any] = dict(blocks.data)
    text = [*blocks.body]
    operations = size * (blocks.operations + 2 * m) if curved else 0
    if curved:
        data[f"{name}_weights"] = np.concatenate([weights, np.zeros((m, size - n))], axis=1)
        text.append(_block_function(blocks, value))
    for k, t in linear:
        data[f"{name}_slopes"] = data.get(f"{name}_slopes", 0.0) + _slopes(k, t, X, weights)
        operations += 2 * weights.shape[0] * X.shape[1]
    lines = Written(f"{name}_lines", Z)
    if linear:
        line = " + ".join(expression(lines, k, t) for k, t in linear)
        text.append(_lines_function(lines, line, size))
    variance: dict[str, Any] = {f"{name}_factor": packed(factor)} if factor is not None else {}
    variance |= lines.data
    if order is not None:
        variance[f"{name}_order"] = order
    sizes = (n, size, m, X.shape[1])
    text.append(_prior_function(name, diagonal(name, kernel, theta)))
    text.append(_function(name, sizes, bool(curved), bool(linear), factor is not None, order is not None))
    more = (n * n + size * lines.operations) if factor is not None else 0
    return Code("\n".join(text), data, variance, work=2 * size + 3 * BLOCK, operations=(operations, more))


class UnwritableError(Exception):
    """Something has no C; its one argument names it."""


def expression(out: Written, kernel: Kernel, theta: Array) -> str:
    """The covariance of x with point i of the block as C. UnwritableError if there is none."""
    if isinstance(kernel, Sum | Product):
        sign = " + " if isinstance(kernel, Sum) else " * "
        parts = [expression(out, part, share) for part, share in kernel.shares(theta)]
        out.operations += len(parts) - 1
        return f"({sign.join(parts)})"
    if isinstance(kernel, SquaredExponential):
        log_s0, lengths = kernel._split(theta)
        pairs = [(float(0.5 / ell**2), d) for ell, d in zip(lengths, kernel.dims, strict=True)]
        terms = [f"t = x[{d}] - {out.column(d)}[i]; s += {real(c)} * t * t;" for c, d in pairs]
        out.exponents.append("\n            ".join(terms))
        out.operations += 4 * len(terms) + EXPONENTIAL + 1
        exponential = f"e[{len(out.exponents) - 1}][i]"
        return exponential if kernel.unit else f"{real(np.exp(2.0 * log_s0))} * {exponential}"
    if isinstance(kernel, Linear):
        terms = []
        for slope, d in zip(np.exp(2.0 * theta), kernel.dims, strict=True):
            out.slopes.append(f"{real(slope)} * x[{d}]")
            terms.append(f"a{len(out.slopes) - 1} * {out.column(d)}[i]")
        out.operations += 2 * len(terms)
        return f"({' + '.join(terms)})"
    if isinstance(kernel, RestNoise):
        return "R(0.0)"
    inner = kernel.wrapped if isinstance(kernel, PluginKernel) else kernel
    if not isinstance(inner, BlockKernel):
        raise UnwritableError(_title(kernel))
    return _call(out, inner, theta)


def _call(out: Written, kernel: BlockKernel, theta: Array) -> str:
    number = len(out.calls)
    name = f"{out.name}_own{number}"
    code = kernel.c_block(name, theta, out.Z)
    out.data |= code.data
    out.body.append(code.body)
    out.calls.append(f"{name}(x, first, own[{number}]);")
    out.operations += code.operations[0]
    return f"own[{number}][i]"


def _title(kernel: Kernel) -> str:
    name = repr(kernel.plugin) if isinstance(kernel, PluginKernel) else type(kernel).__name__
    return f"the kernel {name}"


def _block_function(out: Written, value: str) -> str:
    """name_k: covariances of x with the block of points from `first` on."""
    lines = [f"static void {out.name}_k(const real *x, int first, real *k)", "{", "    int i;"]
    lines += _preparation(out)
    for s, terms in enumerate(out.exponents):
        lines += [
            "    for (i = 0; i < BLOCK; ++i) {",
            "        real t, s = R(0.0);",
            f"            {terms}",
            f"        e[{s}][i] = -s;",
            "    }",
        ]
    if out.exponents:
        lines.append(f"    exponentials(e[0], {len(out.exponents)} * BLOCK);")
    lines += [f"    {call}" for call in out.calls]
    if not (out.columns or out.slopes or out.exponents):
        lines.append("    (void)x;" if not out.calls else "")
    lines += ["    for (i = 0; i < BLOCK; ++i)", f"        k[i] = {value};", "}", ""]
    return "\n".join(lines)


def _preparation(out: Written) -> list[str]:
    lines = [f"    const real a{i} = {slope};" for i, slope in enumerate(out.slopes)]
    lines += [f"    const real *const z{d} = {out.name}_z{d} + first;" for d in sorted(out.columns)]
    lines += [f"    real e[{len(out.exponents)}][BLOCK];"] if out.exponents else []
    lines += [f"    real own[{len(out.calls)}][BLOCK];"] if out.calls else []
    return lines


def _lines_function(out: Written, value: str, size: int) -> str:
    """name_lines: adds what is linear in x to the covariances with all points."""
    return "\n".join(
        [
            "#if VARIANCE",
            f"static void {out.name}(const real *x, real *k)",
            "{",
            "    int first, i;",
            f"    for (first = 0; first < {size}; first += BLOCK) {{",
            *(f"    {line}" for line in _preparation(out)),
            "        for (i = 0; i < BLOCK; ++i)",
            f"            k[first + i] += {value};",
            "    }",
            "}",
            "#endif",
            "",
        ]
    )


def _prior_function(name: str, prior: str) -> str:
    """name_prior: k(x, x)."""
    return f"""#if VARIANCE
static real {name}_prior(const real *x)
{{
    (void)x;
    return {prior};
}}
#endif
"""


def _function(
    name: str, sizes: tuple[int, int, int, int], curved: bool, linear: bool, factored: bool, ordered: bool
) -> str:
    """name: mean, and variance if factored. sizes: points, points in whole blocks, outputs, inputs."""
    text = [f"static void {name}(const real *x, real *mean, real *variance)", "{"]
    text += _mean(name, sizes, curved, linear)
    if factored:
        text += [
            "#if VARIANCE",
            "    if (variance) {",
            *_variance(name, sizes, linear, ordered),
            "    }",
            "#else",
        ]
    text += ["    (void)variance;"]
    text += ["#endif"] if factored else []
    return "\n".join([*text, "}", ""])


def _mean(name: str, sizes: tuple[int, int, int, int], curved: bool, linear: bool) -> list[str]:
    """The declarations, and the loops of the mean over blocks of points and over slopes."""
    _, size, m, width = sizes
    text: list[str] = []
    if curved:
        text += [
            f"    real k[VARIANCE ? {size} : BLOCK], sums[{m}][BLOCK] = {{{{R(0.0)}}}};",
            "    int first, i, o;",
            f"    for (first = 0; first < {size}; first += BLOCK) {{",
            "        real *const here = k + (VARIANCE ? first : 0);",
            f"        {name}_k(x, first, here);",
            f"        for (o = 0; o < {m}; ++o) {{",
            f"            const real *const w = {name}_weights + o * {size} + first;",
            "            for (i = 0; i < BLOCK; ++i)",
            "                sums[o][i] += w[i] * here[i];",
            "        }",
            "    }",
        ]
    else:
        text += ["#if VARIANCE", f"    real k[{size}] = {{R(0.0)}};", "#endif", "    int o;"]
    text += [
        f"    for (o = 0; o < {m}; ++o)",
        f"        mean[o] = {'total(sums[o])' if curved else 'R(0.0)'};",
    ]
    if linear:
        text += [
            f"    for (o = 0; o < {m}; ++o) {{",
            f"        const real *const w = {name}_slopes + o * {width};",
            "        int d;",
            f"        for (d = 0; d < {width}; ++d)",
            "            mean[o] += w[d] * x[d];",
            "    }",
        ]
    return text


def _variance(name: str, sizes: tuple[int, int, int, int], linear: bool, ordered: bool) -> list[str]:
    """The variance: the prior's less the squares of the factor's solution, which ends once it is enough."""
    n, size, m, _ = sizes
    text = [f"        {name}_lines(x, k);"] if linear else []
    points = "k"
    if ordered:
        points = "own"
        text += [
            f"        real own[{size}] = {{R(0.0)}};",
            "        int i;",
            f"        for (i = 0; i < {n}; ++i)",
            f"            own[i] = k[{name}_order[i]];",
        ]
    text += [f"        const real prior = {name}_prior(x);", "        real enough = variance[0];"]
    if m > 1:
        text += [
            f"        for (o = 1; o < {m}; ++o)",
            "            enough = variance[o] < enough ? variance[o] : enough;",
        ]
    return [
        *text,
        f"        variance[0] = prior - squared({name}_factor, {points}, {n}, prior - enough);",
        "        if (variance[0] < R(0.0))",
        "            variance[0] = R(0.0);",
        f"        for (o = 1; o < {m}; ++o)",
        "            variance[o] = variance[0];",
    ]


def _without_linear(
    kernel: Kernel, theta: Array
) -> tuple[list[tuple[Kernel, Array]], list[tuple[Kernel, Array]]]:
    """The summands that take a loop over the points, and those that are linear in x."""
    parts = kernel.shares(theta) if isinstance(kernel, Sum) else [(kernel, theta)]
    parts = [(part, share) for part, share in parts if not isinstance(part, RestNoise)]
    return (
        [(part, share) for part, share in parts if not isinstance(part, Linear)],
        [(part, share) for part, share in parts if isinstance(part, Linear)],
    )


def _slopes(kernel: Kernel, theta: Array, X: Array, weights: Array) -> Array:
    """(m, D) weights on x of Σ_i w_i Σ_d a_d² x_d z_id."""
    assert isinstance(kernel, Linear)
    slopes = np.zeros((len(weights), X.shape[1]))
    dims = list(kernel.dims)
    slopes[:, dims] = (weights @ X[:, dims]) * np.exp(2.0 * theta)
    return slopes


def diagonal(name: str, kernel: Kernel, theta: Array) -> str:
    """k(x, x) as C; what has code of its own is asked under the names that `expression` gave it."""
    numbers = iter(range(len(theta) + 1))

    def of(part: Kernel, share: Array) -> str:
        if isinstance(part, Sum | Product):
            sign = " + " if isinstance(part, Sum) else " * "
            return f"({sign.join(of(k, t) for k, t in part.shares(share))})"
        if isinstance(part, SquaredExponential):
            return real(np.exp(2.0 * part._split(share)[0]))
        if isinstance(part, Linear):
            terms = zip(np.exp(2.0 * share), part.dims, strict=True)
            return "(" + " + ".join(f"{real(a)} * x[{d}] * x[{d}]" for a, d in terms) + ")"
        if isinstance(part, RestNoise):
            return f"{real(np.exp(2.0 * share[0]))} * x[{part.column}] * x[{part.column}]"
        return f"{name}_own{next(numbers)}_diagonal(x)"

    return of(kernel, theta)


PIVOTS = 96
"""Points that are put first because they tell most: most variances are then known to be small from fewer
rows.
"""


@threads_for(0)  # exported models are of few points
def greedy_order(L: Array) -> tuple[Index, Array]:
    """Points (n,) in an order in which each of the first tells most beside those before, and (n, n) the
    inverse of the lower Cholesky factor of their covariance in that order.

    The greedy order of a pivoted Cholesky decomposition (Higham, Accuracy and Stability of Numerical
    Algorithms, 2002, 10.3).

    Args:
        L: (n, n) lower Cholesky factor of the covariance, noise included.
    """
    K = L @ L.T
    n, left, rows = len(K), K.diagonal().copy(), np.zeros((min(PIVOTS, len(K)), len(K)))
    first: list[int] = []
    for i in range(len(rows)):
        best = int(np.argmax(left))
        rows[i] = (K[best] - rows[:i, best] @ rows[:i]) / np.sqrt(left[best])
        left -= rows[i] ** 2
        first.append(best)
        left[first] = -np.inf
        if not left.max() > 0.0:
            break
    order = np.concatenate([first, np.setdiff1d(np.arange(n), first)]).astype(np.int64)
    return order, triangular_inverse(factorise(np.asfortranarray(K[np.ix_(order, order)]), 0.0)[0])


def packed(A: Array) -> Array:
    """A lower triangular (n, n) row by row, each filled up to whole lanes, as `squared` takes it."""
    n = len(A)
    width = (np.arange(n) // LANE + 1) * LANE
    out = np.zeros(int(width.sum()))
    for i, start in enumerate(np.cumsum(width) - width):
        out[start : start + i + 1] = A[i, : i + 1]
    return out


def merged_functions(name: str, parts: Sequence[tuple[Code, str, tuple[int, ...]]]) -> Code:
    """One function of several, each with its own outputs: (code, its function, places of its outputs)."""
    calls = []
    for _, function, places in parts:
        calls += ["#if VARIANCE"]
        calls += [f"    if (variance) spread[{i}] = variance[{place}];" for i, place in enumerate(places)]
        calls += ["#endif"]
        calls.append(f"    {function}(x, own, variance ? spread : 0);")
        for i, place in enumerate(places):
            calls.append(f"    mean[{place}] = own[{i}];")
            calls.append(f"    if (variance) variance[{place}] = spread[{i}];")
    most = max(len(places) for *_, places in parts)
    head = f"static void {name}(const real *x, real *mean, real *variance)\n{{"
    declaration = f"    real own[{most}] = {{R(0.0)}}, spread[{most}] = {{R(0.0)}};"
    body = "\n".join([*(code.body for code, *_ in parts), head, declaration, *calls, "}", ""])
    data = {key: value for code, *_ in parts for key, value in code.data.items()}
    variance = {key: value for code, *_ in parts for key, value in code.variance.items()}
    counts = [sum(code.operations[i] for code, *_ in parts) for i in range(2)]
    work = max(code.work for code, *_ in parts) + 2 * most
    return Code(body, data, variance, work=work, operations=(counts[0], counts[1]))
