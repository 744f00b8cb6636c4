"""NAME_test.c: the golden vectors, what became of them in Python, and a program that compares."""

from __future__ import annotations

import numpy as np

from etude.deploy.c99.golden import Golden
from etude.deploy.c99.header import Form
from etude.deploy.c99.plan import Plan
from etude.deploy.c99.tables import PER_LINE, numbers
from etude.types import Array

EXACT, FAST, SINGLE = 1e-12, 1e-9, 1e-4
"""Largest deviation from Python as a part of each command's limit: double, with -ffast-math, and float."""
OF_NOISE = 0.1
"""Part of a command's own noise by which float may differ: it then adds half a per cent to its deviation."""


def allowed(plan: Plan) -> float:
    """What float may differ by, as a part of a command's limit: what its noise hides, and SINGLE at least."""
    noise = np.zeros(len(plan.limit))
    for candidate in plan.candidates:
        if candidate.process is None:
            continue
        own = candidate.units[1] ** 2 * candidate.calibration * candidate.process.noise_variance
        np.add.at(noise, list(candidate.commands), candidate.weights * own)
    return max(SINGLE, OF_NOISE * float(np.min(np.sqrt(noise) / plan.limit)))


def self_test(plan: Plan, form: Form, vectors: Golden, exact: float) -> str:
    """The program; it prints its largest deviation and ends with 0 where all are small.

    Args:
        exact: what counts as small without -ffast-math.
    """
    own, upper = plan.name, plan.name.upper()
    count = len(vectors.inputs)
    checked = [
        ("mean", "mean(&state, inputs[i], command)"),
        ("instant", "instant(inputs[i], command)"),
        ("gravity", "gravity(inputs[i], command)"),
    ]
    if form.deviations:
        checked.append(("predict", "predict(&state, inputs[i], command, variance)"))
    told = {"mean": vectors.mean, "gravity": vectors.gravity, "instant": vectors.instant}
    tables = [_table("inputs", f"static const {own}_real", vectors.inputs, form.single)]
    for name in dict.fromkeys("mean" if name == "predict" else name for name, _ in checked):
        tables.append(_table(f"want_{name}", "static const double", told[name], False))
    if form.deviations:
        tables.append(_table("want_variance", "static const double", vectors.variance, False))
    flags = ", ".join(str(int(flag)) for flag in vectors.flags)
    parts = "\n".join(_part(own, upper, name, call, count) for name, call in checked)
    spare = f", variance[{upper}_COMMANDS]" if form.deviations else ""
    return f"""/* {own}_test.c: {count} states and what the model said of them where it was learned. */
#include "{own}.h"

#include <math.h>
#include <stdio.h>

#if defined(__FAST_MATH__)
#define SMALL {FAST if not form.single else allowed(plan)!r}
#else
#define SMALL {exact if not form.single else allowed(plan)!r}
#endif

{"".join(tables)}
static const unsigned flags[{count}] = {{
    {flags}}};

static const double limits[{upper}_COMMANDS] = {{
    {", ".join(numbers(plan.limit, False))}}};

static double worst = 0.0;

static void compare(double found, double wanted, double limit)
{{
    const double off = fabs(found - wanted) / limit;
    if (!(off <= worst))
        worst = off;
}}

int main(void)
{{
    {own}_state state;
    {own}_real command[{upper}_COMMANDS]{spare};
    int i, j, wrong = 0;
{parts}
    printf("largest deviation: %.3e of a command's limit; %d wrong flags\\n", worst, wrong);
    return worst <= SMALL && !wrong ? 0 : 1;
}}
"""


def _table(name: str, kind: str, values: Array, single: bool) -> str:
    own = numbers(values, single)
    rows = ",\n    ".join(", ".join(own[i : i + PER_LINE]) for i in range(0, len(own), PER_LINE))
    return f"{kind} {name}[{len(own)}] = {{\n    {rows}}};\n"


def _part(own: str, upper: str, name: str, call: str, count: int) -> str:
    call = call.replace("inputs[i]", f"inputs + i * {upper}_INPUTS")
    wanted = f"want_{'mean' if name == 'predict' else name}"
    lines = [f"    {own}_init(&state);", f"    for (i = 0; i < {count}; ++i) {{"]
    if name in ("mean", "predict"):
        lines.append(f"        wrong += {own}_{call} != flags[i];")
    else:
        lines.append(f"        (void){own}_{call};")
    lines.append(f"        for (j = 0; j < {upper}_COMMANDS; ++j) {{")
    lines.append(f"            compare(command[j], {wanted}[i * {upper}_COMMANDS + j], limits[j]);")
    if name == "predict":
        lines.append(
            f"            compare(variance[j], want_variance[i * {upper}_COMMANDS + j],"
            f" limits[j] * limits[j]);"
        )
    return "\n".join([*lines, "        }", "    }"])
