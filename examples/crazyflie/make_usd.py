"""Makes log16 from log16_yaw_first.csv: python make_usd.py. The flight as the card of the vehicle holds it.

The CSV has means over ten samples in SI units; here they are in the firmware's units again. Format: the
firmware's tools/usdlog, version 2.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

GRAVITY, FULL = 9.80665, 65535.0
HERE = Path(__file__).parent


def usd_bytes(events: Mapping[str, tuple[np.ndarray, Mapping[str, tuple[str, Sequence[float]]]]]) -> bytes:
    """A log of these kinds of events: name -> times (T,) in s, and variable -> its type and values (T,)."""
    parts = [struct.pack("<BHH", 0xBC, 2, len(events))]
    rows: list[tuple[float, bytes]] = []
    for number, (name, (times, variables)) in enumerate(events.items()):
        parts.append(struct.pack("<H", number) + name.encode() + b"\0" + struct.pack("<H", len(variables)))
        parts += [f"{variable}({kind})".encode() + b"\0" for variable, (kind, _) in variables.items()]
        packed = struct.Struct("<" + "".join(kind for kind, _ in variables.values()))
        own = zip(*(values for _, values in variables.values()), strict=True)
        for t, row in zip(times, own, strict=True):
            rows.append((t, struct.pack("<HQ", number, round(1e6 * t)) + packed.pack(*row)))
    data = b"".join([*parts, *(row for _, row in sorted(rows, key=lambda row: row[0]))])
    return data + struct.pack("<I", zlib.crc32(data))


def main() -> None:
    """Writes the file."""
    table = np.genfromtxt(HERE / "log16_yaw_first.csv", delimiter=",", skip_header=1)
    t, force, rates, motors = table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7:11]
    variables: dict[str, tuple[str, Sequence[float]]] = {}
    for i, axis in enumerate("xyz"):
        variables[f"acc.{axis}"] = ("f", (force[:, i] / GRAVITY).tolist())
        variables[f"gyro.{axis}"] = ("f", np.rad2deg(rates[:, i]).tolist())
    for i in range(4):
        variables[f"motor.m{i + 1}"] = ("H", np.round(FULL * motors[:, i]).astype(int).tolist())
    (HERE / "log16").write_bytes(usd_bytes({"fixedFrequency": (t, variables)}))


if __name__ == "__main__":
    main()
