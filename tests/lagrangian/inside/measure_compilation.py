"""CPU seconds until the sweeps of the Lagrangian prior are compiled, with nothing on disk.

python tests/lagrangian/inside/measure_compilation.py
"""

from __future__ import annotations

import os
import tempfile
import time

import numpy as np


def main() -> None:
    """Prints the seconds of each."""
    from etude_lagrangian import all_outputs, one_output

    J, n = 4, 8
    p, F, G = np.ones((J + 5, J)), np.ones((4, J, n)), np.zeros((J, n, J, n))
    calls = {
        "sweep_all": lambda: all_outputs.sweep_all(p, F, F, 0, G, False, F, p),
        "means_all": lambda: all_outputs.means_all(p, F, F, np.ones((J, n)), np.zeros((J, n))),
        "sweep": lambda: one_output.sweep(0, p, F, F, 0, np.zeros((n, n)), False, F, p),
    }
    for name, call in calls.items():
        began = time.process_time()
        call()
        print(f"{name} {time.process_time() - began:.2f}")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        main()
