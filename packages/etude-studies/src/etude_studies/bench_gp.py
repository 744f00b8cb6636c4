"""`etude bench gp`: the regression's arithmetic beside the least that linear algebra needs for it.

Each figure and its reference run alternately in this process, on one BLAS thread, and each is the median over
the repeats, so that a busy machine weighs on both alike. References:

* likelihood with gradient: one `dpotrf` and one `dpotri` of that order, in place.
* mean-variance gradient: the forward and the back solve of the batch, `L^-1 K_XT` and `L^-T (L^-1 K_XT)`.
* ivr gradient: the forward and the back solve of the batch, of the references (the gradient contains
  `K_RX W`; the measured time starts from the bare reference inputs too), and with the Cholesky factor of S.
  The products between these solves are in the figure and not in the reference.

Then other libraries, as far as they are installed, and a sparse spectrum: `bench_peers`.
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf, dpotri

from etude.models import ExactGP, ExactPosterior, SquaredExponential, initial_gp
from etude.progress import counted
from etude.threads import threads_for
from etude.types import Array
from etude_studies import bench_peers
from etude_studies.peers.catalogue import EXACT, SPECTRUM
from etude_studies.rows import Row, rows_json, table

if TYPE_CHECKING:
    from etude.design import Criterion

INPUTS, POINTS, BATCH, REFERENCES = 12, 500, 300, 100
LIKELIHOOD_REPEATS = {500: 60, 1000: 20, 3000: 5}
GRADIENT_REPEATS = 60


def run(*, json: bool = False, seed: int = 0, quick: bool = False, pythons: Sequence[Path] = ()) -> list[Row]:
    """Measure all rows and print them: a table, or with `json` the one line of `rows_json`.

    `quick` leaves out the other libraries' largest n; `pythons` are interpreters to look for them in.
    """
    rng = np.random.default_rng(seed)
    with threads_for(0):
        sizes = counted(LIKELIHOOD_REPEATS.items(), whole=0.5)
        rows = [likelihood_row(n, repeats, rng) for n, repeats in sizes]
        rows += [mean_variance_row(rng), ivr_row(rng)]
    rows += beside_others(seed, quick, pythons)
    if json:
        print(rows_json(rows, _command(quick, pythons)))  # noqa: T201
    else:
        table(rows, f"exact Gaussian process, D = {INPUTS}; gradients: {BATCH} points at n = {POINTS}")
    return rows


def beside_others(seed: int, quick: bool, pythons: Sequence[Path]) -> list[Row]:
    """The rows of `bench_peers`, on data that do not depend on the rows before them."""
    rng = np.random.default_rng(seed)
    sizes = [n for n in bench_peers.REPEATS if not quick or n <= bench_peers.QUICK]
    problems = {n: random_process(n, rng) for n in sizes}
    rows = bench_peers.peer_rows(problems, EXACT, pythons)
    return rows + bench_peers.spectrum_rows(INPUTS, rng, SPECTRUM, pythons)


def _command(quick: bool, pythons: Sequence[Path]) -> str:
    chosen = [f"--python {shlex.quote(str(python))}" for python in pythons] + ["--quick"] * quick
    return " ".join(["etude bench gp", *chosen, "--json"])


def medians(first: Callable[[], object], second: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median times of two functions run alternately, in ms, after one unmeasured run of each."""
    first()
    second()
    times = np.empty((repeats, 2))
    for i in range(repeats):
        for j, function in enumerate((first, second)):
            start = time.perf_counter()
            function()
            times[i, j] = time.perf_counter() - start
    a, b = 1e3 * np.median(times, axis=0)
    return float(a), float(b)


def random_process(n: int, rng: np.random.Generator) -> tuple[ExactGP, Array, Array]:
    """A process at its starting hyperparameters, with n points to condition it on."""
    X, y = rng.uniform(-1.0, 1.0, size=(n, INPUTS)), rng.normal(size=n)
    return initial_gp(SquaredExponential(tuple(range(INPUTS))), X, y), X, y


def likelihood_row(n: int, repeats: int, rng: np.random.Generator) -> Row:
    """Log marginal likelihood with its gradient against dpotrf + dpotri, both from n points."""
    gp, X, y = random_process(n, rng)
    covariance = np.asfortranarray(gp.kernel.gram(gp.theta, X)[0] + gp.noise_variance * np.eye(n))
    work = np.empty_like(covariance)

    def reference() -> None:
        work[...] = (
            covariance  # refilled, as the factorisation is in place; no allocation is charged to LAPACK
        )
        L, _ = dpotrf(work, lower=1, overwrite_a=1, clean=0)
        dpotri(L, lower=1, overwrite_c=1)

    value, floor = medians(lambda: gp.log_marginal_likelihood(X, y), reference, repeats)
    return Row(f"nlml_gradient_n{n}", value, "ms", "dpotrf+dpotri", floor)


def mean_variance_row(rng: np.random.Generator) -> Row:
    """Mean variance of the batch with its gradient against the two solves of the batch."""
    from etude.design import mean_variance

    value, floor = _criterion_times(mean_variance, rng, references=0)
    return Row(f"mean_variance_gradient_n{POINTS}", value, "ms", "triangular solves of the batch", floor)


def ivr_row(rng: np.random.Generator) -> Row:
    """ivr with its gradient, references included, against all its triangular solves."""
    from etude.design import ivr

    value, floor = _criterion_times(ivr, rng, references=REFERENCES)
    named = f"triangular solves of batch, {REFERENCES} references and S"
    return Row(f"ivr_gradient_n{POINTS}", value, "ms", named, floor)


def _criterion_times(criterion: Criterion, rng: np.random.Generator, references: int) -> tuple[float, float]:
    """Time of a criterion with gradient, from inputs alone, and of its triangular solves, in ms."""
    from etude.design import Output, evaluate

    gp, X, y = random_process(POINTS, rng)
    posterior = gp.condition(X, y)
    batch = rng.uniform(-1.0, 1.0, size=(BATCH, INPUTS))
    reference = rng.uniform(-1.0, 1.0, size=(references, INPUTS))
    gains = np.ones((BATCH, 1))

    def measured() -> None:
        evaluate(criterion, [Output.of(posterior, reference)], batch, gains)

    return medians(measured, _solves(posterior, references, rng), GRADIENT_REPEATS)


def _solves(posterior: ExactPosterior, references: int, rng: np.random.Generator) -> Callable[[], None]:
    right_sides = [np.asfortranarray(rng.normal(size=(POINTS, BATCH + references)))]
    factors = [posterior.L]
    if references:
        S = posterior.covariance(X := rng.uniform(-1.0, 1.0, size=(BATCH, INPUTS)), X)
        factors.append(np.asfortranarray(np.linalg.cholesky(S + posterior.noise_variance * np.eye(BATCH))))
        right_sides.append(np.asfortranarray(rng.normal(size=(BATCH, references))))

    def solves() -> None:
        for L, right in zip(factors, right_sides, strict=True):
            half = dtrsm(1.0, L, right, lower=1)
            dtrsm(1.0, L, half, lower=1, trans_a=1, overwrite_b=1)

    return solves
