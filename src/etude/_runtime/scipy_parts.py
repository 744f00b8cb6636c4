"""BLAS, LAPACK and L-BFGS-B as SciPy has them, without what `import scipy.linalg` brings along.

`scipy.linalg` loads a seventh of a second of what no process here asks for (`numpy.f2py`, `scipy.fft`), each
time a command starts. The routines are in two files of it, which are loaded by themselves; where they are not
found there, from the package. They are the same routines: the same bits.

`scipy.optimize` loads a seventh of a second of other optimisers, each time a motion is asked for. Its
L-BFGS-B is one compiled file that says where it wants to know the function next; this is the conversation
with it, of the versions in which it is known. Of another version `scipy.optimize.minimize` holds it: the same
points, bit for bit.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ExtensionFileLoader, PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

__all__ = [
    "dgemm",
    "dpotrf",
    "dpotri",
    "dpotrs",
    "dsyr",
    "dsyrk",
    "dtrmm",
    "dtrsv",
    "dtrtri",
    "dtrtrs",
    "extension",
    "loaded",
]


def extension(package: str, name: str) -> Any:
    """A compiled file of a package of SciPy, without that package; None if it is not there, or not alone."""
    whole = f"scipy.{package}.{name}"
    try:
        if f"scipy.{package}" in sys.modules:
            return importlib.import_module(whole)
        spec = PathFinder.find_spec(whole, [str(Path(scipy.__file__).parent / package)])
        if spec is None or not isinstance(spec.loader, ExtensionFileLoader):
            return None
        found = module_from_spec(spec)
        spec.loader.exec_module(found)
    except ImportError:  # it needs its package, or there is none of that name
        return None
    return found


def loaded(name: str, public: str) -> Any:
    """A compiled file of `scipy.linalg` by itself, or the public module where that cannot be."""
    found = extension("linalg", name)
    return importlib.import_module(public) if found is None else found


_blas, _lapack = loaded("_fblas", "scipy.linalg.blas"), loaded("_flapack", "scipy.linalg.lapack")

dgemm, dsyr, dsyrk, dtrmm, dtrsv = _blas.dgemm, _blas.dsyr, _blas.dsyrk, _blas.dtrmm, _blas.dtrsv
dpotrf, dpotri, dpotrs = _lapack.dpotrf, _lapack.dpotri, _lapack.dpotrs
dtrtri, dtrtrs = _lapack.dtrtri, _lapack.dtrtrs


Array = NDArray[np.float64]
Function = Callable[[Array], tuple[float, Array]]

VERSIONS = ("1.15", "1.16", "1.17")
"""Of SciPy, whose compiled file is spoken to."""
SIGNATURE = "setulb(m,x,l,u,nbd,f,g,factr,pgtol,wa,iwa,task,lsave,isave,dsave,maxls,ln_task)"
DECREASE, SLOPE = 2.2204460492503131e-09, 1e-5
"""A relative decrease, and a largest slope, below which it has converged: SciPy's own."""
BOTH = 2
"""What a bound's flag says of a parameter that is bounded on both sides."""
NEXT_POINT, WANTED = 1, 3
"""What it answers: an iteration has ended; value and gradient are wanted."""


def minimise(
    function: Function,
    start: Array,
    *,
    steps: int,
    kept: int = 10,
    searched: int = 20,
    evaluations: int = 15000,
    bounds: Sequence[tuple[float, float]] | None = None,
) -> None:
    """Asks `function` for value and gradient where a minimum is looked for; the caller remembers the best.

    Args:
        function: (P,) -> its value and gradient (P,).
        start: (P,) where it begins.
        steps: iterations, at most.
        kept: steps that the curvature is taken from.
        searched: evaluations along one direction, at most.
        evaluations: in all, after which no iteration begins.
        bounds: of each parameter, both of them finite; None: there are none.
    """
    compiled = _compiled()
    if compiled is None:
        options = {"maxiter": steps, "maxcor": kept, "maxls": searched, "maxfun": evaluations}
        _by_package(function, start, options, bounds)
    else:
        _spoken_to(compiled, function, start, (steps, kept, searched, evaluations), bounds)


def _compiled() -> Any:
    """Its `setulb`, or None where that is another than the one known."""
    if ".".join(scipy.__version__.split(".")[:2]) not in VERSIONS:
        return None
    found = getattr(extension("optimize", "_lbfgsb"), "setulb", None)
    return found if getattr(found, "__doc__", "") == SIGNATURE else None


def _by_package(
    function: Function, start: Array, options: dict[str, int], bounds: Sequence[tuple[float, float]] | None
) -> None:
    from scipy.optimize import minimize

    minimize(function, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)


def _spoken_to(
    setulb: Any,
    function: Function,
    start: Array,
    most: tuple[int, int, int, int],
    bounds: Sequence[tuple[float, float]] | None,
) -> None:
    """The conversation: it keeps its state in the arrays that it is given each time."""
    steps, kept, searched, evaluations = most
    size, done, asked = len(start), 0, 0
    ends = np.zeros((2, size)) if bounds is None else np.array(bounds, dtype=float).T.copy()
    flags = np.full(size, 0 if bounds is None else BOTH, dtype=np.int32)
    x, value, gradient = np.clip(start, *ends) if bounds else np.array(start), 0.0, np.zeros(size)
    work = np.zeros(2 * kept * size + 5 * size + 11 * kept * kept + 8 * kept)
    places, state = np.zeros(3 * size, dtype=np.int32), np.zeros(29)
    task, along, flow, counts = (np.zeros(length, dtype=np.int32) for length in (2, 2, 4, 44))
    tolerances = DECREASE / np.finfo(float).eps, SLOPE
    while True:
        settings = kept, x, ends[0], ends[1], flags, value, gradient, *tolerances
        setulb(*settings, work, places, task, flow, counts, state, searched, along)
        if task[0] == WANTED:
            value, gradient = function(x.copy())
            gradient = np.array(gradient, dtype=float)
            asked += 1
        elif task[0] != NEXT_POINT:
            return
        else:
            done += 1
            if done >= steps or asked > evaluations:
                return
