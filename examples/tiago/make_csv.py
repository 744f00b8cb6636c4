"""Makes tiago_exciting.csv from the recording in NumPy form: python make_csv.py tiago_exciting.npz.

The recording is the log of figaroh-examples, examples/tiago/data/identification/dynamic, decoded into t (T,)
and, for the torso's lift and seven arm joints, q and effort (T, 8). Joints arm_5 to arm_7 are left out: their
effort is zero throughout. The driver's velocity is left out too. Superfluous digits are cut.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

JOINTS = ("torso_lift", "arm_1", "arm_2", "arm_3", "arm_4")


def main(source: Path, target: Path) -> None:
    """Writes the CSV: t in s, then position (rad, m for the lift) and current (A) of each joint."""
    data, count = np.load(source), len(JOINTS)
    rows = np.column_stack([data["t"], data["q"][:, :count], data["effort"][:, :count]])
    headers = ["t", *(f"{j}_joint.position" for j in JOINTS), *(f"{j}_joint.current" for j in JOINTS)]
    formats = ["%.4f", *["%.6f"] * count, *["%.4f"] * count]
    np.savetxt(target, rows, fmt=formats, delimiter=",", header=",".join(headers), comments="")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(__file__).with_name("tiago_exciting.csv"))
