"""Makes tx40_exciting.csv from the recording in NumPy form: python make_csv.py tx40_exciting.npz.

The recording is the log of figaroh-examples, examples/staubli_TX40/data, decoded into t (T,) at 5 kHz and, on
the joint side, q and tau (T, 6). Ten samples in a row are averaged into one, positions and torques alike, so
nothing is shifted against anything; at 50 Hz the mean over 2 ms keeps 0.984 of an oscillation.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

AVERAGED = 10


def main(source: Path, target: Path) -> None:
    """Writes the CSV: t in s, then position (rad) and torque (N m) of each joint, at 500 Hz."""
    data = np.load(source)
    rows = np.column_stack([data["t"], data["q"], data["tau"]])
    whole = len(rows) // AVERAGED * AVERAGED
    means = rows[:whole].reshape(-1, AVERAGED, rows.shape[1]).mean(axis=1)
    headers = ["t", *(f"q_joint_{j}" for j in range(1, 7)), *(f"tau_joint_{j}" for j in range(1, 7))]
    formats = ["%.4f", *["%.6f"] * 6, *["%.4f"] * 6]
    np.savetxt(target, means, fmt=formats, delimiter=",", header=",".join(headers), comments="")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(__file__).with_name("tx40_exciting.csv"))
