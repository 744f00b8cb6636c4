"""Makes crazyflie_flights.csv from the recording in NumPy form: python make_csv.py crazyflie.npz.

The recording is logs_crazyflie/log10, log15 and log16 of arplaboratory/data-driven-system-identification,
decoded into time, accelerometer (g), gyroscope (deg/s) and four motor set-points (0 .. 65535) of each log at
about 1 kHz. The windows are the authors' excitations, without take-off and landing. All samples within
10 ms are averaged into one row at the middle of the 10 ms.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

WINDOWS_S = {10: [(35.0, 65.0)], 15: [(55.0, 90.0)], 16: [(32.0, 38.0), (45.0, 49.0)]}
BIN_S = 0.01
GRAVITY, FULL = 9.80665, 65535.0


def main(source: Path, target: Path) -> None:
    """Writes the CSV: number of the flight, t in s, specific force, rates and set-points (of full scale)."""
    data, parts = np.load(source), []
    for flight, windows in WINDOWS_S.items():
        t, force, rate, motor = (
            data[f"log{flight}_{name}"] for name in ("t", "acc_g", "gyro_dps", "motor_u16")
        )
        signals = np.column_stack([force * GRAVITY, np.deg2rad(rate), motor / FULL]).astype(float)
        for start, end in windows:
            bins = np.floor((t - start) / BIN_S).astype(int)
            use = (bins >= 0) & (bins < round((end - start) / BIN_S))
            sums = np.zeros((bins[use].max() + 1, signals.shape[1]))
            np.add.at(sums, bins[use], signals[use])
            middle = start + (np.arange(len(sums)) + 0.5) * BIN_S
            means = sums / np.bincount(bins[use])[:, None]
            parts.append(np.column_stack([np.full(len(sums), flight), middle, means]))
    headers = ["flight", "t", "force_x", "force_y", "force_z", "rate_x", "rate_y", "rate_z"]
    headers += [f"motor_{m}" for m in range(1, 5)]
    formats = ["%d", "%.3f", *["%.3f"] * 3, *["%.4f"] * 3, *["%.5f"] * 4]
    rows = np.concatenate(parts)
    np.savetxt(target, rows, fmt=formats, delimiter=",", header=",".join(headers), comments="")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(__file__).with_name("crazyflie_flights.csv"))
