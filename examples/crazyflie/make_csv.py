"""Makes the four CSV files from the recording in NumPy form: python make_csv.py crazyflie.npz.

The recording is logs_crazyflie/log10, log15 and log16 of arplaboratory/data-driven-system-identification,
decoded into time, accelerometer (g), gyroscope (deg/s) and four motor set-points (0 .. 65535) of each log at
about 1 kHz. The windows are the authors' excitations, without take-off and landing. All samples within
10 ms are averaged into one row at the middle of the 10 ms.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

WINDOWS_S = {
    "log10_thrust": (35.0, 65.0),
    "log15_roll_pitch": (55.0, 90.0),
    "log16_yaw_first": (32.0, 38.0),
    "log16_yaw_second": (45.0, 49.0),
}
HEADERS = ["t [s]", *(f"acc_{a} [m/s^2]" for a in "xyz"), *(f"gyro_{a} [rad/s]" for a in "xyz")]
HEADERS += [f"motor_{m}" for m in range(1, 5)]
FORMATS = ["%.3f", *["%.3f"] * 3, *["%.4f"] * 3, *["%.5f"] * 4]
BIN_S = 0.01
GRAVITY, FULL = 9.80665, 65535.0


def main(source: Path, folder: Path) -> None:
    """Writes the CSVs: t in s of the recording, specific force, rates and set-points (of full scale)."""
    data = np.load(source)
    for name, (start, end) in WINDOWS_S.items():
        log = name.split("_")[0]
        t, force, rate, motor = (data[f"{log}_{part}"] for part in ("t", "acc_g", "gyro_dps", "motor_u16"))
        signals = np.column_stack([force * GRAVITY, np.deg2rad(rate), motor / FULL]).astype(float)
        bins = np.floor((t - start) / BIN_S).astype(int)
        use = (bins >= 0) & (bins < round((end - start) / BIN_S))
        sums = np.zeros((bins[use].max() + 1, signals.shape[1]))
        np.add.at(sums, bins[use], signals[use])
        middle = start + (np.arange(len(sums)) + 0.5) * BIN_S
        rows = np.column_stack([middle, sums / np.bincount(bins[use])[:, None]])
        text = {"delimiter": ",", "header": ",".join(HEADERS), "comments": ""}
        np.savetxt(folder / f"{name}.csv", rows, fmt=FORMATS, **text)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(__file__).parent)
