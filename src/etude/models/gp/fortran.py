"""BLAS and LAPACK on blocks inside a matrix.

SciPy's wrappers take whole arrays: of a block inside one they make a copy, which costs what working by blocks
gains. So the routines are called where SciPy offers them to compiled code (`scipy.linalg.cython_blas`), by
address. All arguments are addresses, as Fortran wants them: the letters below, `number`, `whole`, and of a
block `place` of its first entry. Nothing is checked here: whoever calls answers for shapes and for the order.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from ctypes import (
    CFUNCTYPE,
    PYFUNCTYPE,
    byref,
    c_char,
    c_char_p,
    c_double,
    c_int,
    c_void_p,
    py_object,
    pythonapi,
)
from dataclasses import dataclass
from functools import cache
from typing import Any

from scipy import LowLevelCallable

from etude.blas import loaded

Routine = Callable[..., None]

INTEGER = re.compile(r"(?<!\w)int \*")
LEFT = LOWER = byref(c_char(b"L"))
RIGHT = byref(c_char(b"R"))
UPPER = byref(c_char(b"U"))
PLAIN = byref(c_char(b"N"))
"""Not transposed; or a diagonal that is read."""
TRANSPOSED = byref(c_char(b"T"))


@dataclass(frozen=True)
class Routines:
    """The routines in double precision, named as in BLAS and LAPACK."""

    gemm: Routine
    syrk: Routine
    trmm: Routine
    trsm: Routine
    potrf: Routine
    trtri: Routine
    lauum: Routine
    laset: Routine


@cache
def routines() -> Routines | None:
    """They, or None if this SciPy's have other integers than C's `int`, as with a BLAS of 64 bits."""
    cython_blas, cython_lapack = (
        loaded(f"cython_{name}", f"scipy.linalg.cython_{name}") for name in ("blas", "lapack")
    )
    found = [
        _routine(cython_blas, "dgemm", integers=6),
        _routine(cython_blas, "dsyrk", integers=4),
        _routine(cython_blas, "dtrmm", integers=4),
        _routine(cython_blas, "dtrsm", integers=4),
        _routine(cython_lapack, "dpotrf", integers=3),
        _routine(cython_lapack, "dtrtri", integers=3),
        _routine(cython_lapack, "dlauum", integers=3),
        _routine(cython_lapack, "dlaset", integers=3),
    ]
    return None if None in found else Routines(*found)


@cache
def number(value: float) -> Any:
    """The address of a number that nobody writes to."""
    return byref(c_double(value))


@cache
def whole(value: int) -> Any:
    """The address of an integer that nobody writes to."""
    return byref(c_int(value))


def place(address: int) -> Any:
    """The address of a block's first entry, as an argument."""
    return c_void_p(address)


def _routine(module: Any, name: str, *, integers: int) -> Any:
    found = LowLevelCallable.from_cython(module, name)
    if len(INTEGER.findall(found.signature)) != integers:
        return None
    address = PYFUNCTYPE(c_void_p, py_object, c_char_p)(("PyCapsule_GetPointer", pythonapi))
    # without argument types: their conversion would take as long as the rest of the call
    return CFUNCTYPE(None)(address(found.function, found.signature.encode()))
