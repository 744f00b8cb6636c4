"""C99 of an arm's inputs and of its rigid body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from etude.models.c99 import mean_function
from etude.models.gp.c99 import real
from etude.types import Code
from etude_arm.memory import MEMORY_RATE
from etude_arm.spec import FIRST_WAVE, PATH, PLAN, RIPPLES

FUNCTION = 40
"""Operations of one tanh or exp of the C library."""
PARAMETERS = 10  # of a body: mass, first moments, inertia


def inputs_code(name: str, inputs: Any) -> Code:
    """Code of `ArmInputs`; memory of each joint: friction state, position behind the play, start."""
    J, reads = len(inputs.stick_velocity), inputs.names
    q, qd, _ = reads
    data: dict[str, Any] = {}
    lines = [f"    for (j = 0; j < {J}; ++j) {{"]
    for block, channel in enumerate(reads):
        lines.append(f"        x[{block * J} + j] = c_{channel}[j];")
    at = 3 * J
    for number, threshold in enumerate(inputs.thresholds):
        data[f"{name}_speed{number}"] = threshold
        lines.append(f"        x[{at} + j] = TANH(c_{qd}[j] / {name}_speed{number}[j]);")
        at += J
    memory = 0
    if inputs.presliding is not None and inputs.play is not None and inputs.slow is not None:
        data |= {
            f"{name}_play": inputs.play,
            f"{name}_length": inputs.presliding,
            f"{name}_slow": inputs.slow,
        }
        lines += (
            _REMEMBERED.replace("NAME", name)
            .replace("Q_", f"c_{q}")
            .replace("QD_", f"c_{qd}")
            .replace("HELD_", str(at))
            .replace("REST_", str(at + J))
            .replace("JOINTS_", str(J))
            .splitlines()
        )
        memory = 2 * J + 1
    lines.append("    }")
    lines.append(f"    memory[{memory - 1}] = R(1.0);" if memory else "    (void)memory;")
    arguments = ", ".join([*(f"const real *c_{channel}" for channel in reads), "real *memory", "real *x"])
    body = "\n".join([f"static void {name}({arguments})", "{", "    int j;", *lines, "}", ""])
    functions = len(inputs.thresholds) + (2 if memory else 0)
    # 12: products and sums of one joint in the loop above
    return Code(body, data, reads=reads, memory=memory, operations=(J * (functions * FUNCTION + 12), 0))


_REMEMBERED = """\
        {
            const real low = Q_[j] - NAME_play[j], high = Q_[j] + NAME_play[j];
            const real p = memory[2 * JOINTS_] == R(0.0) ? Q_[j] : memory[JOINTS_ + j];
            const real behind = p < low ? low : p > high ? high : p;
            const real way = behind - p, rest = EXP(-FABS(QD_[j]) / NAME_slow[j]);
            if (way != R(0.0)) {
                const real sign = way > R(0.0) ? R(1.0) : R(-1.0);
                memory[j] = sign + (memory[j] - sign) * EXP(-FABS(way) / NAME_length[j]);
            }
            memory[JOINTS_ + j] = behind;
            x[HELD_ + j] = memory[j] * rest;
            x[REST_ + j] = rest;
        }"""


def rigid_body_code(name: str, mean: Any, friction_scales: Sequence[float]) -> Code:
    """Code of a `RigidBodyMean`: Newton-Euler with parameters of each output, in the drives' coordinates."""
    from importlib import resources

    model, reads = mean.model, PLAN if mean.desired else PATH
    B, J = model.tree.bodies, model.tree.joints
    tables = _rigid_body_tables(model)
    text = resources.files("etude_arm.physics").joinpath("rigid_body.c").read_text(encoding="utf-8")
    sizes: dict[str, Any] = {"BODIES": B, "JOINTS": J, "EXTRAS": model.extra.shape[1], "MEAN": name}
    for word, value in sizes.items():
        text = text.replace(f"@{word}", str(value))
    scales = ", ".join(real(s) for s in friction_scales)
    text = text.replace("@SCALES", scales)
    text = text.replace("@RIPPLE", _RIPPLE.replace("NAME", name) if model.ripple is not None else "")
    remembers = bool(model.way.any())
    if remembers:
        tables["way"] = np.where(model.way > 0.0, mean.spec.presliding(1.0) * model.way, 1.0)
    whole = text + "\n" + _remembering(name, reads, J, remembers)
    data = {f"{name}_{key}": table for key, table in tables.items()}
    pairs = int(tables["paths"].sum())
    # products and sums, counted in the template: of a body, a Jacobian, a pair of bodies, and the solution
    waves = 0 if model.ripple is None else 2 * RIPPLES * J
    operations = 400 * B + 60 * J * B + 40 * J * pairs + 2 * J**3 + (4 * J + waves) * FUNCTION
    held = {"memory": 2 * J + 1, "rate": MEMORY_RATE} if remembers else {}
    return Code(
        whole, data, reads=reads, work=24 * B + 3 * J * J + 20 * J, operations=(operations, 0), **held
    )


def _rigid_body_tables(model: Any) -> dict[str, Any]:
    """Arrays of an identified rigid body by their names in the template: tree, drives, parameters."""
    tree, drives = model.tree, model.drives
    B, J = tree.bodies, tree.joints
    paths = np.zeros((B, J), dtype=np.int64)
    for body in range(1, B):
        paths[body, tree.path(body)] = 1
    order = [j for body in range(1, B) for j in np.flatnonzero(tree.joint_body == body)]
    first = [0, *np.cumsum([np.sum(tree.joint_body == body) for body in range(B)]).tolist()]
    sites = [0, *np.cumsum([len(drive.bodies) for drive in drives]).tolist()]
    count = max(sites[-1], 1)
    points = np.concatenate([np.zeros((0, 3)), *(drive.points for drive in drives)])
    bodies = np.concatenate([np.zeros(0, dtype=np.int64), *(drive.bodies for drive in drives)])
    tables: dict[str, Any] = {
        "parent": tree.parent,
        "position": tree.position,
        "rotation": tree.rotation,
        "first": np.array(first),
        "order": np.array(order),
        "axis": tree.joint_axis,
        "anchor": tree.joint_anchor,
        "slides": tree.joint_slides.astype(np.int64),
        "zero": tree.joint_zero,
        "paths": paths,
        "gravity": tree.gravity,
        "inertial": model.inertial,
        "extra": model.extra,
        "speed": model.friction_velocity,
        "resting": np.array(
            [drive.resting(j, float(model.friction_velocity[j])) for j, drive in enumerate(drives)]
        ),
        "side": np.array([drive.side(j) * (model.way[j] > 0.0) for j, drive in enumerate(drives)]),
        "gear": np.array([drive.gear for drive in drives]),
        "coefficients": np.stack([drive.coefficients for drive in drives]),
        "sites": np.array(sites),
        "site_body": np.resize(bodies, count) if len(bodies) else np.zeros(1, dtype=np.int64),
        "site_point": points if len(points) else np.zeros((1, 3)),
    }
    if model.ripple is not None:
        tables["ripple"] = model.ripple
    return tables


def _remembering(name: str, reads: Sequence[str], J: int, remembers: bool) -> str:
    """The mean's two functions; memory of each joint: friction, previous position, start."""
    call = f"    {name}_commands({', '.join(f'c_{channel}' for channel in reads)}, {{}}, command);"
    turned = _TURNED.replace("NAME", name).replace("JOINTS_", str(J)).replace("Q_", f"c_{reads[0]}")
    lines = [*turned.splitlines(), call.format("memory")] if remembers else [call.format("0")]
    return mean_function(name, reads, lines, [call.format("0")], memory=remembers)


_RIPPLE = f"""\
        for (s = 0; s < {RIPPLES}; ++s) {{
            const real angle = (real)(s + {FIRST_WAVE}) * q[j];
            command[j] += NAME_ripple[{2 * RIPPLES} * j + 2 * s] * SIN(angle);
            command[j] += NAME_ripple[{2 * RIPPLES} * j + 2 * s + 1] * COS(angle);
        }}
"""

_TURNED = """\
    int i;
    for (i = 0; i < JOINTS_; ++i) {
        const real way = memory[2 * JOINTS_] == R(0.0) ? R(0.0) : Q_[i] - memory[JOINTS_ + i];
        if (way != R(0.0)) {
            const real sign = way > R(0.0) ? R(1.0) : R(-1.0);
            memory[i] = sign + (memory[i] - sign) * EXP(-FABS(way) / NAME_way[i]);
        }
        memory[JOINTS_ + i] = Q_[i];
    }
    memory[2 * JOINTS_] = R(1.0);"""
