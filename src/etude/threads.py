"""Thread and memory settings for small linear algebra: one thread, memory kept between evaluations.

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
KEPT_BYTES = 31 * 2**20
"""Just below the largest block for which glibc learns (32 MB)."""


@cache
def _controller() -> Any:
    # numpy and scipy are loaded first, so that both of their libraries are found
    import numpy as np
    from threadpoolctl import ThreadpoolController

    import etude._runtime.scipy_parts  # noqa: F401

    # glibc returns freed blocks to the kernel until it has seen one as large as this come and go; then it
    # keeps them. Without it every evaluation faults its matrices in again: a quarter of an ivr gradient.
    np.empty(KEPT_BYTES, dtype=np.uint8)
    return ThreadpoolController()


_limited: list[Any] = []
"""Limits of the blocks that are open, the outermost first."""


@contextmanager
def threads_for(order: int) -> Iterator[None]:
    """One BLAS thread inside the block if matrices of this order are small, else as many as the user has set.

    A block of large matrices inside one of small ones gets the user's number, too. It decorates functions.
    """
    if order <= SMALL:
        with _controller().limit(limits=1, user_api="blas") as limit:
            _limited.append(limit)
            try:
                yield
            finally:
                _limited.pop()
    elif _limited:
        before = _limited[0].get_original_num_threads()["blas"]
        with _controller().limit(limits=before, user_api="blas"):
            yield
    else:
        yield
