"""Written files simulated open loop: from states of unseen logs, with the logged torques, for half a second.

    python tests/foreign/measure_open_loop.py three:5,three:6

MuJoCo plays the file as it came, the file that `etude export --to mjcf` wrote, and that with its cogging.csv.
"""

from __future__ import annotations

import csv
import io
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
import pinocchio_arm as plant
from measure_parameters import learned, robot
from pinocchio_arm import Array
from small_arm import URDF

import etude

AHEAD_S, STEP_S = 0.5, 1e-3
UNSEEN = 90
"""Seed of the run that no file was made of."""


def played(model: mujoco.MjModel, names: tuple[str, ...], log: Array, ripple: Array) -> Array:
    """(J,) rms error of position after AHEAD_S, rad; log (n, 1 + 3 J): time, positions, velocities, torques.

    Args:
        ripple: (J, W, 3) periods, sine and cosine of the cogging.
    """
    J, step = len(names), round(AHEAD_S / (log[1, 0] - log[0, 0]))
    model.opt.timestep = STEP_S
    data = mujoco.MjData(model)
    places = [model.joint(name) for name in names]
    at, dofs = (np.array([int(getattr(p, word)[0]) for p in places]) for word in ("qposadr", "dofadr"))
    errors = []
    for start in range(step, len(log) - step, step):
        mujoco.mj_resetData(model, data)
        data.qpos[at], data.qvel[dofs] = log[start, 1 : 1 + J], log[start, 1 + J : 1 + 2 * J]
        for now in range(round(AHEAD_S / STEP_S)):
            q = data.qpos[at]
            waves = ripple[..., 1] * np.sin(ripple[..., 0] * q[:, None]) + ripple[..., 2] * np.cos(
                ripple[..., 0] * q[:, None]
            )
            row = log[start + int(now * STEP_S / (log[1, 0] - log[0, 0]))]
            data.qfrc_applied[dofs] = row[1 + 2 * J :] - waves.sum(axis=1)
            mujoco.mj_step(model, data)
        errors.append(data.qpos[at] - log[start + step, 1 : 1 + J])
    return np.asarray(np.sqrt(np.mean(np.square(errors), axis=0)))


def ripple_of(path: Path, names: tuple[str, ...]) -> Array:
    """(J, W, 3) of cogging.csv."""
    rows = list(csv.DictReader(path.open()))
    return np.array(
        [
            [
                [float(row[word]) for word in ("periods", "sine", "cosine")]
                for row in rows
                if row["joint"] == name
            ]
            for name in names
        ]
    )


def main() -> None:
    print("| robot | joint | file as it came, mrad | written | with cogging | count of the encoder |")
    for name in sys.argv[1].split(","):
        arm, text = robot(name)
        with tempfile.TemporaryDirectory() as folder:
            campaign = learned(Path(folder), arm, 0, text)
            written = etude.export(campaign, "mjcf")
            table = (etude.ask(campaign, go_on=True).folder / "trajectory.csv").read_bytes()
            run = plant.run(arm, plant.reference_of_table(table, arm.names), seed=UNSEEN)
            log = np.loadtxt(io.StringIO(run.log().decode()), delimiter=",", skiprows=1)
            file = mujoco.MjModel.from_xml_path(str(written.folder / written.files[0]))
            none = np.zeros((len(arm.names), 1, 3))
            before = played(mujoco.MjModel.from_xml_string(text or URDF), arm.names, log, none)
            after = played(file, arm.names, log, none)
            cogged = played(file, arm.names, log, ripple_of(written.folder / "cogging.csv", arm.names))
        for j, joint in enumerate(arm.names):
            cells = " | ".join(f"{1e3 * one[j]:.2f}" for one in (before, after, cogged))
            print(f"| {name} | {joint} | {cells} | {1e3 * arm.drives.encoder:.3f} |", flush=True)


if __name__ == "__main__":
    main()
