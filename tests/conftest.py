"""Settings of all tests: none is timed, automatic runs draw the same examples every time, BLAS has one thread.

Products here are small. Two pools of two threads on two cores wait for each other: the everyday suite took
twice the time.
"""

from __future__ import annotations

import os

# before numpy is loaded; the processes that tests start inherit it
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import settings  # noqa: E402

settings.register_profile("etude", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("etude")
