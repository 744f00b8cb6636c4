"""A small arm learned from a log that pinocchio made, and its exports asked as their receivers ask them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import etude
from compilers import STRICT, run, tool

pin = pytest.importorskip(
    "pinocchio", reason="pinocchio has no wheel for this Python or system: pip install pin"
)
Array = NDArray[np.float64]
JOINTS = ("turn", "lift", "bend")
LOWER, UPPER = np.array([-2.9, -1.9, -2.4]), np.array([2.9, 1.9, 2.4])
SPEED, TORQUE = np.array([2.0, 2.0, 2.5]), np.array([60.0, 90.0, 45.0])
STIFFNESS = np.array([900.0, 900.0, 500.0])
"""N m/rad of the servos."""
LINKS = ((2.5, (0.02, 0.01, 0.05)), (3.0, (0.18, -0.01, 0.02)), (1.8, (0.15, 0.02, -0.01)))
"""Mass in kg and centre in m of each link."""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{at}"/><axis xyz="{axis}"/>
<limit lower="{lower}" upper="{upper}" velocity="{speed}" effort="{torque}"/></joint>
<link name="{child}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0.001" ixz="0" iyz="0"/></inertial></link>"""


def urdf() -> str:
    """The arm: a turn about z, then two joints that lift."""
    text, parent = '<robot name="small"><link name="base"/>', "base"
    places = (("0 0 0.2", "0 0 1"), ("0 0 0.1", "0 1 0"), ("0.35 0 0", "0 1 0"))
    for j, (at, axis) in enumerate(places):
        mass, centre = LINKS[j]
        text += JOINT.format(
            name=JOINTS[j], parent=parent, child=f"link{j}", at=at, axis=axis, lower=LOWER[j], upper=UPPER[j],
            speed=SPEED[j], torque=TORQUE[j], mass=mass, centre=" ".join(map(str, centre)),
        )  # fmt: skip
        parent = f"link{j}"
    return f"{text}</robot>"


def body() -> tuple[Any, Any]:
    """Pinocchio's model of it, and its workspace."""
    model = pin.buildModelFromXML(urdf())
    return model, model.createData()


def swings(seconds: float, rate: float, share: float = 0.16, seed: int = 0) -> tuple[Array, Array]:
    """t (T,) s, and q, qd, qdd (3, T, J) of a Fourier motion through a part of each range."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    orders = np.zeros((3, len(t), len(JOINTS)))
    orders[0] += np.array([0.5, 0.6, 0.7])
    for harmonic in range(1, 5):
        w = 2.0 * np.pi * harmonic / 8.0
        a = share * (UPPER - LOWER) / harmonic / 3.0 * rng.uniform(0.5, 1.0, len(JOINTS))
        phase = w * t[:, None] + rng.uniform(0.0, 2.0 * np.pi, len(JOINTS))
        orders += np.stack([a * np.sin(phase), a * w * np.cos(phase), -a * w**2 * np.sin(phase)])
    return t, orders


def torques(orders: Array, *, ideal: bool = False, noisy: bool = True) -> Array:
    """(T, J) of rigid bodies by recursive Newton-Euler; with friction, cogging and noise unless ideal."""
    model, data = body()
    found = np.stack([pin.rnea(model, data, *row) for row in np.swapaxes(orders, 0, 1)])
    if ideal:
        return found
    q, qd = orders[:2]
    dry = 0.03 * TORQUE * np.tanh(qd / 0.01) + 0.02 * TORQUE / SPEED * qd
    noise = float(noisy) * 0.002 * TORQUE * np.random.default_rng(1).standard_normal(q.shape)
    return np.asarray(found + dry + 0.004 * TORQUE * np.sin(5.0 * q) + noise)


def lab(folder: Path, *, seconds: float = 24.0, ideal: bool = False, **settings: Any) -> Path:
    """A campaign of that arm with one log learned; settings of [model], as campaign.toml writes them."""
    (folder / "small.urdf").write_text(urdf(), encoding="utf-8")
    etude.create_campaign(folder / "lab", folder / "small.urdf")
    config = folder / "lab" / "campaign.toml"
    text = config.read_text(encoding="utf-8")
    words = {"points": 120, "inducing": 0, "fit_points": 80, "steps": 8, **settings}
    head, model = text.split("[model]", 1)
    for name, value in words.items():
        told = repr(value).replace("'", '"').replace("True", "true")
        model, count = re.subn(rf"^{name} = [^#\n]*", f"{name} = {told} ", model, count=1, flags=re.MULTILINE)
        assert count == 1, name
    config.write_text(f"{head}[model]{model}", encoding="utf-8")
    t, orders = swings(seconds, 100.0)
    path = folder / "log.csv"
    command = torques(orders, ideal=ideal)
    # a servo of that stiffness was told to go further by what it takes: its law can be seen in the log
    told = orders[0] + torques(orders, ideal=ideal, noisy=False) / STIFFNESS
    write_table(path, t, orders, command, told)
    etude.tell(etude.open_campaign(folder / "lab"), path)
    return folder / "lab"


def write_table(
    path: Path, t: Array, orders: Array, command: Array | None = None, told: Array | None = None
) -> Path:
    """A user's CSV with times, states and perhaps torques and set-points of positions."""
    blocks = [*zip(("q", "qd", "qdd"), orders, strict=False)]
    blocks += [] if command is None else [("command", command)]
    blocks += [] if told is None else [("q_des", told)]
    header = ["time", *(f"{word}_{joint}" for word, _ in blocks for joint in JOINTS)]
    rows = np.column_stack([t, *(values for _, values in blocks)])
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    path.write_text("\n".join([",".join(header), *lines]) + "\n", encoding="utf-8")
    return path


def legal(count: int, seed: int = 5) -> Array:
    """(3, T, J) states that the limits allow, mostly far from all that was trained."""
    rng = np.random.default_rng(seed)
    shape = (count, len(JOINTS))
    q, qd = rng.uniform(LOWER, UPPER, shape), rng.uniform(-SPEED, SPEED, shape)
    qdd = rng.uniform(-4.0, 4.0, shape)
    qd[::4], qdd[::4] = 0.0, 0.0  # some at rest
    return np.stack([q, qd, qdd])


PROGRAM = """\
#include "NAME.h"
#include <stdio.h>
int main(void)
{
    NAME_state state;
    NAME_real in[UPPER_INPUTS], out[3][UPPER_COMMANDS];
    int i, k;
    NAME_init(&state);
    for (;;) {
        unsigned flags;
        for (i = 0; i < UPPER_INPUTS; ++i)
            if (scanf("%lf", &in[i]) != 1)
                return 0;
        flags = NAME_mean(&state, in, out[0]);
        NAME_instant(in, out[1]);
        NAME_gravity(in, out[2]);
        printf("%u", flags);
        for (k = 0; k < 3; ++k)
            for (i = 0; i < UPPER_COMMANDS; ++i)
                printf(" %.17g", out[k][i]);
        printf("\\n");
    }
}
"""


def built(folder: Path, name: str = "small", level: str = "-O0") -> Path:
    """The receiver's program beside exported C of that name, compiled with every warning an error.

    Not optimised where compiling takes longer than all that is asked. Slow tests of C have all levels.
    """
    program = PROGRAM.replace("NAME", name).replace("UPPER", name.upper())
    (folder / "main.c").write_text(program, encoding="utf-8")
    run([tool("gcc"), *STRICT, level, "main.c", f"{name}.c", "-lm", "-o", "main"], folder)
    return folder / "main"


def asked(program: Path, orders: Array) -> tuple[NDArray[np.int64], Array]:
    """Flags (T,), and what NAME_mean, NAME_instant and NAME_gravity say (3, T, J)."""
    rows = np.concatenate([*orders], axis=1)
    text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    (program.parent / "rows").write_text(text, encoding="utf-8")
    said = run(["sh", "-c", "./main < rows"], program.parent)
    found = np.array([[float(v) for v in line.split()] for line in said.splitlines()])
    return found[:, 0].astype(np.int64), found[:, 1:].reshape(len(rows), 3, -1).swapaxes(0, 1)
