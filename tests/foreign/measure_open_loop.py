"""Written files simulated open loop: from states of an unseen log, with its torques, for half a second.

    python tests/foreign/measure_open_loop.py RESULTS.jsonl three:5,three:6=double,ur5:1=placeholders

MuJoCo plays the file as it came, what `etude export --to mjcf` wrote, and that with the drives' terms; then
both with the plant's own parameters in place of the estimates, which is the best that a file of that form can
do. Masses of the plant are up to 15 % off the robot's file. After = stands what Étude gets in its place:
"double" or "half" the masses, or "placeholders", 1 kg and 1 kg m^2 a link. Campaigns that RESULTS has are not
made again.
"""

from __future__ import annotations

import io
import json
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio_arm as plant
from measure_parameters import learned, robot
from pinocchio_arm import Array
from scipy.optimize import nnls
from small_arm import URDF

import etude
from etude.errors import EtudeError

AHEAD_S, STEP_S = 0.5, 1e-3
UNSEEN = 90
"""Seed of the run that no file was made of."""
COUNTS, PART = 2.0, 0.10
"""Of the encoder, and of the error of the file as it came: the error that is aimed at."""
FACTORS = {"double": 2.0, "half": 0.5}
MASS, INERTIA = re.compile(r'<mass value="([^"]*)"'), re.compile(r"<inertia [^>]*>")
MOMENT = re.compile(r'(i[xyz]{2})="([^"]*)"')
NOTHING = 1e-9
"""kg (kg m^2) of links without a joint: the plant's bodies contain them."""
TURNED = 3.0
"""Speeds over which friction turns, below which c sign(v) is no model of it."""
BRISTLE = 1e-3
"""rad: deflection of LuGre, as in the files that are written."""
PLACEHOLDER = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'


def with_masses(text: str, masses: str) -> str:
    """The URDF that Étude gets."""
    if masses == "placeholders":
        return INERTIA.sub(PLACEHOLDER, MASS.sub('<mass value="1"', text))
    times = FACTORS.get(masses, 1.0)
    text = MASS.sub(lambda own: f'<mass value="{times * float(own[1])!r}"', text)
    return INERTIA.sub(
        lambda own: MOMENT.sub(lambda one: f'{one[1]}="{times * float(one[2])!r}"', own[0]), text
    )


def with_true_bodies(model: mujoco.MjModel, arm: plant.Arm) -> mujoco.MjModel:
    """The model with the plant's masses, armatures and nearest c sign(v) + d v."""
    model.body_mass[1:], model.body_inertia[1:] = NOTHING, NOTHING
    for j, name in enumerate(arm.names):
        body, dof = int(model.joint(name).bodyid[0]), int(model.joint(name).dofadr[0])
        own = arm.true.inertias[j + 1]
        moments, axes = np.linalg.eigh(own.inertia)
        axes = axes * np.sign(np.linalg.det(axes))
        model.body_mass[body], model.body_ipos[body] = own.mass, own.lever
        model.body_inertia[body] = moments
        mujoco.mju_mat2Quat(model.body_iquat[body], axes.ravel())
        model.dof_armature[dof] = arm.drives.armature[j]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def with_true_friction(model: mujoco.MjModel, arm: plant.Arm, log: Array) -> mujoco.MjModel:
    """The model with the c sign(v) + d v that is nearest to the plant's friction at the speeds of the log."""
    J = len(arm.names)
    speed = log[:, 1 + J : 1 + 2 * J]
    force = arm.drives.friction(speed)
    for j, name in enumerate(arm.names):
        rows = np.abs(speed[:, j]) > TURNED * arm.drives.smooth[j]
        columns = np.column_stack([np.sign(speed[rows, j]), speed[rows, j]])
        dof = int(model.joint(name).dofadr[0])
        model.dof_frictionloss[dof], model.dof_damping[dof] = nnls(columns, force[rows, j])[0]
    return model


def true_drives(path: Path, arm: plant.Arm) -> mujoco.MjModel:
    """The written NAME_drives.xml with the plant's cogging and Stribeck friction."""
    tree, drives = ElementTree.parse(path), arm.drives
    actuators = tree.findall("actuator")[-1]
    form = dict(actuators[-1].attrib)
    for word in ("cogging", "lugre"):
        form.pop(word, None)
    actuators.clear()
    joints = {element.get("name"): element for element in tree.iter("joint")}
    for j, name in enumerate(arm.names):
        joints[name].set("frictionloss", repr(float(drives.coulomb[j])))
        joints[name].set("damping", repr(float(drives.viscous[j])))
        stiction = float(drives.stiction[j])
        wave = -float(drives.cogging[j]), int(drives.poles[j]), float(drives.phase[j])
        dip = stiction / BRISTLE, 0.0, 1e-4 * stiction, stiction, float(drives.stribeck[j])
        for word, terms in (("cogging", wave), ("lugre", dip)):
            own = {"name": f"{name} {word}", "joint": name, word: " ".join(map(repr, terms))}
            ElementTree.SubElement(actuators, "dcmotor", form | own)
    written = path.with_name("true_drives.xml")
    tree.write(written)
    return mujoco.MjModel.from_xml_path(str(written))


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


def measured(name: str) -> dict[str, Any]:
    """Of one campaign, by joint: errors of the three files, rad; of torques in parts of the model's."""
    own, _, masses = name.partition("=")
    arm, text = robot(own)
    text = with_masses(text or URDF, masses)
    with tempfile.TemporaryDirectory() as folder:
        campaign = learned(Path(folder), arm, 0, text)
        written = etude.export(campaign, "mjcf")
        table = (etude.ask(campaign, go_on=True).folder / "trajectory.csv").read_bytes()
        run = plant.run(arm, plant.reference_of_table(table, arm.names), seed=UNSEEN)
        log = np.loadtxt(io.StringIO(run.log().decode()), delimiter=",", skiprows=1)
        files = [written.folder / file for file in written.files[:2]]
        plain, drives = (mujoco.MjModel.from_xml_path(str(file)) for file in files)
        models = mujoco.MjModel.from_xml_string(text), plain, drives
        errors = [played(model, arm.names, log).tolist() for model in models]
        best = with_true_friction(plain, arm, log), true_drives(files[1], arm)
        errors += [played(with_true_bodies(model, arm), arm.names, log).tolist() for model in best]
    torques = written.facts["played"]
    ratio = {
        key: [torques[key][joint] / torques["physics"][joint] for joint in arm.names]
        for key in ("file", "drives")
    }
    words = ("came", "file", "drives", "true file", "true drives")
    found = dict(zip(words, errors, strict=True))
    return {"robot": name, "encoder": arm.drives.encoder, **found, "torque": ratio}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown: least and most of each robot's joints, and how many reach what is aimed at."""
    head = ["robot", "joints", "file as it came, rad", "`NAME.xml`, of that", "`NAME_drives.xml`, of that"]
    head += ["joints at the aim", "with true parameters", "torque, of the model's error"]
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for row in rows:
        came = np.array(row["came"])
        cells = [row["robot"], str(len(came)), _ends(came, "{:.2f}")]
        cells += [_ends(100.0 * np.array(row[key]) / came, "{:.1f}") + " %" for key in ("file", "drives")]
        aim = COUNTS * row["encoder"] + PART * came
        for keys in (("file", "drives"), ("true file", "true drives")):
            cells.append(" / ".join(str(int((np.array(row[key]) <= aim).sum())) for key in keys))
        cells.append(" / ".join(_ends(np.array(row["torque"][key]), "{:.2f}") for key in ("file", "drives")))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _ends(values: Array, form: str) -> str:
    return f"{form.format(values.min())} .. {form.format(values.max())}"


def main() -> None:
    """See the module's text."""
    file, names = Path(sys.argv[1]), sys.argv[2].split(",") if len(sys.argv) > 2 else []
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    for name in names:
        if name in [row["robot"] for row in rows]:
            continue
        try:
            rows.append(measured(name))
        except EtudeError as problem:
            print(f"{name}: {problem}", flush=True)
            continue
        with file.open("a") as out:
            out.write(json.dumps(rows[-1]) + "\n")
        print(table(rows[-1:]), flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
