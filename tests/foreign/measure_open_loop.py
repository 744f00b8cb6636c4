"""Written files simulated open loop: from states of unseen logs, with the logged torques, for half a second.

    python tests/foreign/measure_open_loop.py three:5,three:6

MuJoCo plays the file as it came, what `etude export --to mjcf` wrote, and that with the drives' terms.
"""

from __future__ import annotations

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


def played(model: mujoco.MjModel, names: tuple[str, ...], log: Array) -> Array:
    """(J,) rms error of position after AHEAD_S, rad; log (n, 1 + 3 J): time, place, speed, torque."""
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
            row = log[start + int(now * STEP_S / (log[1, 0] - log[0, 0]))]
            data.qfrc_applied[dofs] = row[1 + 2 * J :]
            mujoco.mj_step(model, data)
        errors.append(data.qpos[at] - log[start + step, 1 : 1 + J])
    return np.asarray(np.sqrt(np.mean(np.square(errors), axis=0)))


def main() -> None:
    print("| robot | joint | file as it came, mrad | written | with drives | count of the encoder |")
    for name in sys.argv[1].split(","):
        arm, text = robot(name)
        with tempfile.TemporaryDirectory() as folder:
            campaign = learned(Path(folder), arm, 0, text)
            written = etude.export(campaign, "mjcf")
            table = (etude.ask(campaign, go_on=True).folder / "trajectory.csv").read_bytes()
            run = plant.run(arm, plant.reference_of_table(table, arm.names), seed=UNSEEN)
            log = np.loadtxt(io.StringIO(run.log().decode()), delimiter=",", skiprows=1)
            came = mujoco.MjModel.from_xml_string(text or URDF)
            files = (str(written.folder / file) for file in written.files[:2])
            models = came, *map(mujoco.MjModel.from_xml_path, files)
            errors = [played(model, arm.names, log) for model in models]
        for j, joint in enumerate(arm.names):
            cells = " | ".join(f"{1e3 * one[j]:.2f}" for one in errors)
            print(f"| {name} | {joint} | {cells} | {1e3 * arm.drives.encoder:.3f} |", flush=True)


if __name__ == "__main__":
    main()
