"""How large the file of a recording is: 7 joints, noisy as real arms are.

python tests/drivers/measure_recordings.py --seconds 70 --rate 1000
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from etude.drivers import Ended, Recording, planned, write_recording
from etude.trajectories import PointToPoint

JOINTS = tuple(f"joint{number}" for number in range(7))
NOISE = {"q": 2e-5, "qd": 2e-3, "command": 0.05}
"""Standard deviations: rad, rad/s, N m."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=70.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    given, rng = parser.parse_args(), np.random.default_rng(0)
    path = PointToPoint(
        rng.uniform(-1.0, 1.0, (1 + round(given.seconds / 3.1), 7)), 1.0, peak_acceleration=5.0
    )
    text = path.to_json().encode()
    motion = planned(text, number=1, part="motion", speed=100, names=JOINTS, joints=JOINTS, rate=given.rate)
    noise = {name: size * rng.standard_normal(motion.q.shape) for name, size in NOISE.items()}
    orders = motion.q, motion.qd, motion.qdd
    q, qd, command = (own + noise[name] for name, own in zip(NOISE, orders, strict=True))
    own = (motion, Ended.DONE, "", 100.0, 100.0 + motion.t, motion.t, q, qd, command, motion.q)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "recording.parquet"
        write_recording(file, Recording(*own, reached=motion.duration))
        size = file.stat().st_size / 2**20
    print(f"{motion.duration:.0f} s at {given.rate:g} Hz, {len(JOINTS)} joints: {size:.1f} MiB")


if __name__ == "__main__":
    main()
