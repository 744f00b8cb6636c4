"""Threads of the linear algebra library: one around small matrices, where more cost far more than they give.

Measured on two cores: unrestricted threads made one training on 200 points up to 100 times slower, because
every small product wakes and parks the whole pool. threadpoolctl is used because NumPy and SciPy each bring
their own BLAS with its own switch, and another machine brings others (MKL, Accelerate).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

SMALL = 1500
"""Matrices up to this order are handled by one thread."""


@cache
def _controller() -> Any:
    # numpy and scipy are loaded first, so that both of their libraries are found
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def threads_for(order: int) -> Iterator[None]:
    """One BLAS thread inside the block if matrices of this order are small; the user's setting otherwise."""
    if order > SMALL:
        yield
        return
    with _controller().limit(limits=1, user_api="blas"):
        yield
