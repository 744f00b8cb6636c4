"""Makes ur10_exciting.csv from the recording in NumPy form: python make_csv.py ur10_exciting.npz.

The recording is the ROS 2 bag `ur10_exciting_trajectory.db3` of unisa-acg/inverse-dynamics-solver, topic
/joint_states, decoded into the arrays t (T,), q, qd, tau (T, 6).
Digits beyond the sensors' resolution are cut.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
CHANNELS = {"position": ("q", "%.6f"), "velocity": ("qd", "%.5f"), "effort": ("tau", "%.4f")}


def main(source: Path, target: Path) -> None:
    """Writes the CSV: t in s, then position (rad), velocity (rad/s) and effort (N m) of each joint."""
    data = np.load(source)
    headers, columns, formats = ["t"], [data["t"]], ["%.3f"]
    for channel, (key, digits) in CHANNELS.items():
        for number, joint in enumerate(JOINTS):
            headers.append(f"{joint}_joint.{channel}")
            columns.append(data[key][:, number])
            formats.append(digits)
    np.savetxt(
        target, np.column_stack(columns), fmt=formats, delimiter=",", header=",".join(headers), comments=""
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(__file__).with_name("ur10_exciting.csv"))
