"""The Lagrangian prior as C99: of one command as a kernel, and of all of them together."""

from __future__ import annotations

from importlib import resources
from typing import Any

import numpy as np

from etude.models.gp.c99 import BLOCK, expanded, greedy_order, packed
from etude.types import Array, Code
from etude_lagrangian.joints import Joints

LANE = 16  # columns that a compiler adds side by side
FUNCTION = 40  # operations that one sine or exponential counts as


def kernel_code(name: str, kernel: Any, theta: Array, Z: Array) -> Code:
    """`BlockKernel.c_block` of one command's prior, a `kernel.Lagrangian`."""
    J = kernel.joints.count
    data = _tables(name, kernel.parameters.array(kernel.check(theta)), kernel.joints, Z)
    text = _packed(name, kernel.joints) + _text("one_output.c", name, J).replace("@OWN", str(kernel.own))
    links = J - kernel.own
    # products and sums, counted in one_output.c: joints, links, and the sines of all inputs
    operations = 18 * J + 40 * J + links * (8 * J + 45) + 2 * FUNCTION * J // len(Z)
    return Code(text, data, work=(5 + 17 * J) * LANE, operations=(operations, 0))


def joint_code(name: str, process: Any) -> Code:
    """All commands of one energy, with their additions: a `joint_process.JointProcess`."""
    J, n = len(process.commands), len(process.X)
    size = -(-n // BLOCK) * BLOCK
    Z = np.concatenate([process.X, np.tile(process.X[-1:], (size - n, 1))])
    p, thetas = process.prior.split(process.at.theta)
    data = _tables(name, p, process.prior.joints, Z)
    data[f"{name}_weights"] = np.concatenate([process.alpha, np.zeros((J, size - n))], axis=1)
    entries = len(process.used)
    used = np.full(-(-entries // LANE) * LANE, -1)
    order, factor = greedy_order(process.L)
    used[:entries] = (process.used // n * size + process.used % n)[order]
    variance: dict[str, Any] = {f"{name}_used": used, f"{name}_factor_table": packed(factor)}
    means, spreads, bodies, operations = [], [], [], 0
    for j, (kernel, theta) in enumerate(zip(process.prior.additions, thetas, strict=True)):
        more = f"{name}_more{j}"
        code = expanded(more, kernel, theta, process.X, process.alpha[j : j + 1], None)
        bodies.append(code.body)
        data |= code.data
        variance |= code.variance
        operations += code.operations[0]
        means.append(
            f"    {{\n        real added;\n        {more}(x, &added, 0);\n        mean[{j}] += added;\n    }}"
        )
        spreads.append(_added(more, j, size, f"{more}_k" in code.body, f"{more}_lines" in code.body))
    text = _text("all_outputs.c", name, J).replace("@MEANS", "\n".join(means))
    text = text.replace("@SPREADS", "\n".join(spreads)).replace("@COUNT", str(size))
    text = text.replace("@USED", str(len(used))).replace("@ENTRIES", str(entries))
    body = "\n".join([*bodies, _packed(name, process.prior.joints), text])
    # products and sums for each stored sample, counted in all_outputs.c
    pairs = size * (90 * J + sum(30 * k + 12 * k * k for k in range(1, J + 1)) + 2 * J * J)
    work = (13 + 24 * J + J * J) * LANE
    spread = J * (entries**2 + 2 * size)
    return Code(body, data, variance, work=work, operations=(operations + pairs, spread))


def _added(name: str, j: int, size: int, curved: bool, linear: bool) -> str:
    """C that adds an addition's covariances to those of its command, and its variance."""
    lines = ["        {", f"            real k[{size}] = {{R(0.0)}};"]
    if curved:
        lines += [
            f"            for (i = 0; i < {size}; i += BLOCK)",
            f"                {name}_k(x, i, k + i);",
        ]
    lines += [f"            {name}_lines(x, k);"] if linear else []
    lines += [
        f"            for (i = 0; i < {size}; ++i)",
        f"                every[{j}][{j * size} + i] += k[i];",
        f"            variance[{j}] += {name}_prior(x);",
        "        }",
    ]
    return "\n".join(lines)


def _text(file: str, name: str, joints: int) -> str:
    text = resources.files("etude_lagrangian").joinpath(file).read_text(encoding="utf-8")
    return text.replace("@K", name).replace("@J", str(joints))


def _tables(name: str, p: Array, joints: Joints, Z: Array) -> dict[str, Any]:
    """Parameters, and the points as the formulas take them, a table for each row."""
    F = joints.packed(Z).reshape(4 * joints.count, -1)
    return {f"{name}_parameters": p, **{f"{name}_point{i}": row for i, row in enumerate(F)}}


def _packed(name: str, joints: Joints) -> str:
    """C of `Joints.packed`, and a list of the points' rows."""
    J = joints.count
    lines = []
    for j in range(J):
        q = f"x[{joints.positions[j]}]"
        slides = joints.slides[j]
        lines.append(f"    F[{j}] = {q if slides else f'SIN({q})'};")
        lines.append(f"    F[{J + j}] = {'R(1.0)' if slides else f'COS({q})'};")
        lines.append(f"    F[{2 * J + j}] = x[{joints.speeds[j]}];")
        lines.append(f"    F[{3 * J + j}] = x[{joints.accelerations[j]}];")
    rows = ", ".join(f"{name}_point{i}" for i in range(4 * J))
    head = f"static const real *const {name}_points[] = {{{rows}}};\n"
    return "\n".join([head, f"static void {name}_packed(const real *x, real *F)", "{", *lines, "}", "", ""])
