"""Settings of all tests: none is timed, runs of CI draw the same examples every time, BLAS has one thread.

Products here are small, and the pools of two workers on two cores wait for each other: with more threads the
everyday suite took nearly twice the time.
"""

from __future__ import annotations

import atexit
import gc
import os
import shutil
import signal
import sys
import tempfile

import pytest
from hypothesis import settings

# before numpy is loaded; the processes that tests start inherit it
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# numba writes its cache beside the sources in any case; without their bytecode each of the hundred programs
# that tests start compiles Étude anew, and each worker rewrites the assertions of all tests
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# the list of folders that may name code is the user's, who runs these tests
os.environ["XDG_CONFIG_HOME"] = tempfile.mkdtemp(prefix="etude-config-")
atexit.register(shutil.rmtree, os.environ["XDG_CONFIG_HOME"], ignore_errors=True)
# a shell ignores Ctrl-C for what it starts in the background, and its children inherit that: tests send it
signal.signal(signal.SIGINT, signal.default_int_handler)
# collecting makes objects that stay: looking for garbage among them took a quarter of its time
gc.disable()
settings.register_profile("etude", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.register_profile("etude everyday", settings.get_profile("etude"), max_examples=30)

FIRST = (
    *("test_lagrangian_together", "test_lwpr"),
    *("test_dictionary_stream", "test_vehicle_plant", "test_arm_closed_loop", "test_arm_inverse"),
    "test_lagrangian",
)
"""Files whose tests compile what takes long. While one of two workers compiles the Lagrangian priors, the
other, which takes a file as soon as it is idle, compiles all the rest; then `test_lagrangian` finds both on
disk."""
LONG = "foreign"
"""The room with few tests in a file that take long: at the end they would leave a worker idle."""


def pytest_configure(config: pytest.Config) -> None:
    """Properties have fewer examples every day; `.ci/nightly` asks for all."""
    everyday = config.getoption("markexpr") == "not slow"
    settings.load_profile("etude everyday" if everyday else "etude")


@pytest.hookimpl(trylast=True)  # after those that deselect
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The order in which workers get files: `--no-loadscope-reorder` keeps it."""

    def place(own: pytest.Item) -> tuple[int, bool]:
        name = own.path.stem
        return FIRST.index(name) if name in FIRST else len(FIRST), LONG not in own.path.parts

    items.sort(key=place)


def pytest_collection_finish() -> None:
    """What every test needs until the end is out of the garbage collector's sight, which looks often."""
    gc.collect()
    gc.freeze()
    gc.enable()
