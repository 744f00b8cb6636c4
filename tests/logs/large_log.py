"""Reads a log of 10^6 rows of seven joints and says what it took: python large_log.py [DIGITS]."""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROWS = 1_000_000
JOINTS = tuple(f"joint_{k}" for k in range(1, 8))


def write(path: Path, digits: int) -> None:
    """Positions, velocities and torques at 1 kHz, in blocks: a writer is not what is measured."""
    rng = np.random.default_rng(0)
    omega = 2 * np.pi * (0.1 + 0.02 * np.arange(7))
    names = [f"{word}_{joint}" for word in ("q", "qd", "tau") for joint in JOINTS]
    with path.open("w") as file:
        file.write(",".join(["t", *names]) + "\n")
        for t in np.arange(ROWS).reshape(-1, 10_000) / 1000:
            q = np.sin(np.outer(t, omega)) + 1e-4 * rng.standard_normal((len(t), 7))
            qd = omega * np.cos(np.outer(t, omega))
            tau = 10.0 * q + 0.01 * rng.standard_normal(q.shape)
            np.savetxt(file, np.column_stack([t, q, qd, tau]), delimiter=",", fmt=f"%.{digits}f")


def read(path: Path) -> int:
    """Rows of the log."""
    from etude.logs import read_log
    from etude.types import Channel

    channels = (
        Channel("q", JOINTS, ("rad",) * 7, required=True),
        Channel("qd", JOINTS, ("rad/s",) * 7, derivative_of="q"),
        Channel("command", JOINTS, ("N m",) * 7, "command", required=True, acts_on="q"),
    )
    one = np.ones(7)
    limits = {"q": (-3 * one, 3 * one), "qd": (-5 * one, 5 * one), "command": (-50 * one, 50 * one)}
    return len(read_log(path, channels, rate=1000.0, limits=limits))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--read"]:
        began = time.perf_counter(), time.process_time()
        rows = read(Path(sys.argv[2]))
        wall, core = time.perf_counter() - began[0], time.process_time() - began[1]
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(json.dumps({"rows": rows, "peak_mb": peak, "seconds": wall, "core_seconds": core}))
    else:
        import subprocess

        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "run.csv"
            write(log, int(sys.argv[1]) if len(sys.argv) > 1 else 6)
            print(f"{log.stat().st_size / 1e6:.0f} MB of text", flush=True)
            subprocess.run([sys.executable, __file__, "--read", str(log)], check=True)
