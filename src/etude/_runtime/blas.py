"""BLAS and LAPACK as SciPy wraps them, without what `import scipy.linalg` brings along.

That package loads a seventh of a second of what no process here asks for (`numpy.f2py`, `scipy.fft`), each
time a command starts. The routines are in two files of it, which are loaded by themselves; where they are not
found there, from the package. They are the same routines: the same bits.
"""

from __future__ import annotations

import importlib
import sys
from importlib.machinery import ExtensionFileLoader, PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from typing import Any

import scipy

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
