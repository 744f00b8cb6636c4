"""Settings of all tests: none is timed, runs of CI draw the same examples every time, BLAS has one thread.

Products here are small, and the pools of two workers on two cores wait for each other: with more threads the
everyday suite took nearly twice the time.
"""

from __future__ import annotations

import os

from hypothesis import settings

# before numpy is loaded; the processes that tests start inherit it
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
settings.register_profile("etude", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("etude")
