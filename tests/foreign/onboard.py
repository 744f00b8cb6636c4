"""The exported addition to PX4 as a shared library, called as the control allocator calls it."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from flight_lab import run
from numpy.typing import NDArray
from rotorpy_vehicle import NED, Onboard

from compilers import run as compiled
from compilers import tool

Array = NDArray[np.float64]

STUBS = Path(__file__).parents[1] / "deploy" / "px4_stubs"
ENTRY = """\
#include "own_px4.h"
static own_flight own;
void begin(void) { own_flight_init(&own); }
unsigned add(const float *row, float yaw, float age, float hover, int leans, float dt, float *motors)
{
    struct trajectory_setpoint_s asked = {0};
    struct actuator_motors_s out = {{0}};
    own_px4 beside = {0, 14, hover, 0.0f, leans, DECOUPLE};
    unsigned flags;
    int i;
    for (i = 0; i < 3; ++i) {
        asked.position[i] = row[i];
        asked.velocity[i] = row[3 + i];
        asked.acceleration[i] = row[6 + i];
        asked.jerk[i] = row[9 + i];
    }
    asked.yaw = yaw;
    beside.now = (uint64_t)(1e6f * age);
    for (i = 0; i < 4; ++i)
        out.control[i] = motors[i];
    flags = own_px4_add(&own, &asked, &beside, dt, &out);
    for (i = 0; i < 4; ++i)
        motors[i] = out.control[i];
    return flags;
}
"""


def onboard(
    lab: Path, folder: Path, *, decouple: bool = True, leans: bool = True, dt: float = 0.004
) -> Onboard:
    """What `etude export --to px4` writes, in the allocator of `rotorpy_vehicle.fly`.

    Args:
        decouple: MPC_ACC_DECOUPLE; a controller that tilts by the whole acceleration has 0.
        leans: whether set-points hold against the drag already. dt: s between calls.
    """
    run("export", lab, "--to", "px4", "--name", "own", "--output", folder)
    (folder / "entry.c").write_text(ENTRY.replace("DECOUPLE", str(int(decouple))))
    sources = ["own.c", "own_lean.c", "own_flight.c", "own_px4.c", "entry.c"]
    flags = ["-std=c99", "-O0", "-fPIC", "-shared", f"-I{STUBS}", "-I."]
    compiled([tool("gcc"), *flags, *sources, "-lm", "-o", "own.so"], folder)
    library = ctypes.CDLL(str(folder / "own.so"))
    library.begin()
    single, pointer = ctypes.c_float, ctypes.c_void_p
    library.add.argtypes = [pointer, single, single, single, ctypes.c_int, single, pointer]
    library.add.restype = ctypes.c_uint
    seen: list[Array] = []

    def add(row: Array, t: float, hover: float, motors: Array) -> Array:
        if t <= 0.0:
            library.begin()
            seen.clear()
        sent = row.reshape(3, 3) @ NED.T
        jerk = np.zeros((1, 3))  # play.py sends none
        data = np.ascontiguousarray(np.concatenate([sent, jerk]).ravel(), dtype=np.float32)
        out = np.ascontiguousarray(motors, dtype=np.float32)
        library.add(data.ctypes.data, 0.5 * np.pi, 0.01, hover, int(leans), dt, out.ctypes.data)
        return out.astype(float)

    return add
