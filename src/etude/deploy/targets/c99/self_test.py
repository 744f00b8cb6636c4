"""NAME_test.c: golden vectors, their results in Python, and a program that compares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.deploy.model_states import log_of
from etude.deploy.targets.c99.header import CForm
from etude.deploy.targets.c99.plan import UNBOUNDED, WIDENED, Plan
from etude.deploy.targets.c99.source import PER_LINE, numbers
from etude.models.trust import outside, trust
from etude.types import Array, Index

EXACT, FAST, SINGLE = 1e-12, 1e-9, 1e-4
"""Largest deviation from Python as a part of each command's limit: double, with -ffast-math, and float."""
OF_NOISE = 0.1
"""Part of a command's own noise by which float may differ: it then adds half a per cent to its deviation."""


def float_tolerance(plan: Plan) -> float:
    """Allowed deviation of float as a fraction of the limit: part of the noise, at least SINGLE."""
    noise = np.zeros(len(plan.limit))
    for candidate in plan.candidates:
        if candidate.process is None:
            continue
        variance = candidate.units[1] ** 2 * candidate.calibration * candidate.process.noise_variance
        np.add.at(noise, list(candidate.commands), candidate.weights * variance)
    return max(SINGLE, OF_NOISE * float(np.min(np.sqrt(noise) / plan.limit)))


COUNT = 100  # rows that the built C is held against Python on
SEED = 20  # any: the same rows in every export
SOURCE = "golden vectors"
BEYOND = 1.15
"""Half ranges that most of the states swing through; single ones go far beyond."""
LEAST = 0.1
"""Part of that with which the first swing: far from all points kernels have nothing to say."""
NOT_A_NUMBER, FAR, UNTRAINED, LIMITED = 1, 2, 4, 8  # bits, as arm.h names them


@dataclass(frozen=True, eq=False)
class Golden:
    """A sequence from a state that was just begun.

    Attributes:
        inputs: (T, N). mean, variance, instant, gravity: (T, J), commands within their limits; those of
            instants
            count each row by itself.
        flags: (T,) of the mean.
    """

    inputs: Array
    mean: Array
    variance: Array
    instant: Array
    gravity: Array
    flags: Index


def golden_vectors(
    plan: Plan, count: int = COUNT, seed: int = SEED, *, single: bool = False, fade: bool = True
) -> Golden:
    """Vectors of a plan: every state swings to and fro, so that what remembers directions is asked.

    Args:
        single: inputs that are numbers of float, as its caller has them. fade: as of `LearnedModel.predict`.
    """
    rng = np.random.default_rng(seed)
    middle = 0.5 * (plan.low + plan.high)
    half = 0.5 * (plan.high - plan.low)
    half = np.where(plan.high >= UNBOUNDED, 10.0, half)
    t = np.linspace(0.0, 1.0, count)[:, None]
    # a few swings within the states that are answered, each input at a pace of its own
    cycles = rng.uniform(1.0, 9.0, size=len(half))
    growing = BEYOND * np.linspace(LEAST, 1.0, count)[:, None]  # the first are near what was trained on
    states = middle + growing * half * np.sin(2.0 * np.pi * (cycles * t + rng.uniform(size=len(half))))
    # every 17th state is far outside, where a model fades
    states[::17] = middle + half * rng.uniform(-5.0, 5.0, size=states[::17].shape)
    if single:
        states = states.astype(np.float32).astype(float)
    return expected_outputs(plan, states, fade=fade)


def expected_outputs(plan: Plan, states: Array, *, fade: bool = True) -> Golden:
    """Outputs of the model at states (T, N), in that order."""
    model, log = plan.model, log_of(plan.channels, states, SOURCE)
    prediction = model.predict(log, fade=fade)
    instant = model.predict(dict(log.values), fade=fade).mean
    gravity = model.static(log_of(plan.channels, np.where(plan.still, 0.0, states), SOURCE), fade=fade)
    flags = _flags(plan, states, prediction.unknown, fade)
    flags |= LIMITED * np.any((prediction.mean > plan.most) | (prediction.mean < plan.least), axis=1).astype(
        int
    )
    mean, alone, held = (np.clip(v, plan.least, plan.most) for v in (prediction.mean, instant, gravity))
    return Golden(states, mean, prediction.variance, alone, held, flags)


def _flags(plan: Plan, states: Array, unknown: Array, fade: bool) -> Index:
    """(T,) by what is unknown of commands; without fading by ranges, since nothing else is computed."""
    if fade:
        beyond = outside(unknown, plan.model.known)
        far = trust(unknown, plan.model.signal_deviation, plan.model.known) <= 0.0
    else:
        wide = WIDENED * (plan.high - plan.low)
        beyond = (states < plan.low) | (states > plan.high)
        far = (states < plan.low - wide) | (states > plan.high + wide)
    return np.asarray(UNTRAINED * beyond.any(axis=1).astype(int) | FAR * far.any(axis=1).astype(int))


CALLS = {
    "mean": "mean(&state, inputs[i], command)",
    "instant": "instant(inputs[i], command)",
    "gravity": "gravity(inputs[i], command)",
    "predict": "predict(&state, inputs[i], command, variance)",
}
"""Functions of the header that are compared; the last one where it has deviations."""


def self_test(plan: Plan, form: CForm, vectors: Golden, exact: float) -> str:
    """The program; it prints its largest deviation and ends with 0 where all are small.

    Args:
        exact: what counts as small without -ffast-math.
    """
    prefix, upper = plan.name, plan.name.upper()
    count = len(vectors.inputs)
    flags = ", ".join(str(int(flag)) for flag in vectors.flags)
    checked = CALLS if form.deviations else {name: CALLS[name] for name in CALLS if name != "predict"}
    parts = "\n".join(_part(prefix, upper, name, call, count) for name, call in checked.items())
    deviation = f", variance[{upper}_COMMANDS]" if form.deviations else ""
    return f"""/* {prefix}_test.c: {count} states and what the model said of them where it was learned. */
#include "{prefix}.h"

#include <math.h>
#include <stdio.h>

#if defined(__FAST_MATH__)
#define SMALL {FAST if not form.single else float_tolerance(plan)!r}
#else
#define SMALL {exact if not form.single else float_tolerance(plan)!r}
#endif

{_tables(prefix, form, vectors)}
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
    {prefix}_state state;
    {prefix}_real command[{upper}_COMMANDS]{deviation};
    int i, j, wrong = 0;
{parts}
    printf("largest deviation: %.3e of a command's limit; %d wrong flags\\n", worst, wrong);
    return worst <= SMALL && !wrong ? 0 : 1;
}}
"""


def _tables(prefix: str, form: CForm, vectors: Golden) -> str:
    """Tables of states and expected outputs."""
    outputs = {"mean": vectors.mean, "instant": vectors.instant, "gravity": vectors.gravity}
    outputs |= {"variance": vectors.variance} if form.deviations else {}
    tables = [_table("inputs", f"static const {prefix}_real", vectors.inputs, form.single)]
    tables += [_table(f"want_{name}", "static const double", outputs[name], False) for name in outputs]
    return "".join(tables)


def _table(name: str, kind: str, values: Array, single: bool) -> str:
    texts = numbers(values, single)
    rows = ",\n    ".join(", ".join(texts[i : i + PER_LINE]) for i in range(0, len(texts), PER_LINE))
    return f"{kind} {name}[{len(texts)}] = {{\n    {rows}}};\n"


def _part(prefix: str, upper: str, name: str, call: str, count: int) -> str:
    call = call.replace("inputs[i]", f"inputs + i * {upper}_INPUTS")
    expected = f"want_{'mean' if name == 'predict' else name}"
    lines = [f"    {prefix}_init(&state);", f"    for (i = 0; i < {count}; ++i) {{"]
    if name in ("mean", "predict"):
        lines.append(f"        wrong += {prefix}_{call} != flags[i];")
    else:
        lines.append(f"        (void){prefix}_{call};")
    lines.append(f"        for (j = 0; j < {upper}_COMMANDS; ++j) {{")
    lines.append(f"            compare(command[j], {expected}[i * {upper}_COMMANDS + j], limits[j]);")
    if name == "predict":
        lines.append(
            f"            compare(variance[j], want_variance[i * {upper}_COMMANDS + j],"
            f" limits[j] * limits[j]);"
        )
    return "\n".join([*lines, "        }", "    }"])
