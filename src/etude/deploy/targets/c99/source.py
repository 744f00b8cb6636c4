"""The source file in C99: tables, the parts' own code, and the functions of the header around them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np

from etude.abilities import SupportsDrag
from etude.deploy.targets.c99.header import CForm
from etude.deploy.targets.c99.plan import WIDENED, Plan
from etude.errors import NumericalError
from etude.models.gp.c99 import real
from etude.models.selection.member_prediction import level_of, rests_of
from etude.models.trust import NEVER, ROUNDING, thresholds
from etude.types import Array, Code

PER_LINE = 6  # numbers: lines stay below 120 characters


def numbers(values: Any, single: bool) -> list[str]:
    """Numbers that read back exactly: of a float the shortest that does."""
    array = np.ravel(values)
    if array.dtype.kind in "iub":
        return [str(int(value)) for value in array]
    # the text of a finite number has a point or an exponent, as C's has
    if single:
        return [f"{value!s}f" for value in array.astype(np.float32)]
    return [repr(value) for value in array.astype(float).tolist()]


def table(name: str, values: Any, single: bool, kind: str = "static const") -> str:
    """Definition of one table."""
    texts = numbers(values, single)
    word = "int" if np.asarray(values).dtype.kind in "iub" else "real"
    rows = [", ".join(texts[i : i + PER_LINE]) for i in range(0, len(texts), PER_LINE)]
    lines = ",\n    ".join(rows)
    return f"{kind} {word} {name}[{len(texts)}] = {{\n    {lines}}};\n"


def tables(data: Mapping[str, Any], single: bool) -> tuple[str, int]:
    """Definitions of all tables, equal ones as aliases of the first; and their size in bytes."""
    names: dict[tuple[str, bytes], str] = {}
    text, size = [], 0
    for name, values in data.items():
        array = np.asarray(values)
        whole = array.dtype.kind in "iub"
        plain = array.astype(np.int64 if whole else np.float64).ravel()
        key = ("int" if whole else "real", plain.tobytes())
        if key in names:
            text.append(f"#define {name} {names[key]}\n")
            continue
        names[key] = name
        text.append(table(name, plain, single))
        # bytes of int or float, else of double
        size += plain.size * (4 if whole or single else 8)
    return "".join(text), size


def finite(data: Mapping[str, Any]) -> bool:
    """Whether all numbers are finite."""
    return all(bool(np.isfinite(np.asarray(values, dtype=float)).all()) for values in data.values())


def source(plan: Plan, form: CForm) -> tuple[str, int]:
    """NAME.c, and the bytes of its tables. NumericalError: a table has values that are not finite."""
    data: dict[str, Any] = {}
    for code in plan.codes:
        data |= code.data
        data |= code.variance if form.deviations else {}
    if not finite(data):
        raise NumericalError(
            "the model contains numbers that are not finite",
            next_step="Do not run it. Train the model again.",
        )
    text, size = tables(data, form.single)
    conditions = {"VARIANCE": form.deviations, "SINGLE": form.single}
    bodies = preprocessed("\n".join(code.body for code in plan.codes), conditions)
    answer = _answer(plan, form)
    remainder = f"{bodies}\n{answer}\n{_functions(plan, form)}"
    head = f"""/* {plan.name}.c: generated; {plan.name}.h describes its use. */
#include "{plan.name}.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#define VARIANCE {int(form.deviations)}

typedef {plan.name}_real real;

/* A call is one of a run, an instant by itself, of which nothing is remembered, or a robot at rest. */
enum {{RUN, INSTANT, STILL}};

"""
    ranges = [
        table(f"{plan.name}_{name}", values, form.single, kind)
        for name, values, kind in (
            ("low", plan.low, "const"),
            ("high", plan.high, "const"),
            ("least", plan.least, "const"),
            ("most", plan.most, "const"),
        )
    ]
    # bytes of float or double
    size += (2 * len(plan.low) + 2 * len(plan.limit)) * (4 if form.single else 8)
    return "\n".join([head + preprocessed(prelude(remainder), conditions), *ranges, text, remainder]), size


def preprocessed(text: str, conditions: Mapping[str, bool]) -> str:
    """The text without the inactive parts of `#if WORD`, `#else` and `#endif`; compilers warn of them."""
    active: list[str] = []
    open_parts: list[bool] = []
    for line in text.splitlines():
        first, _, word = line.partition(" ")
        if first == "#if" and word in conditions:
            open_parts.append(conditions[word])
        elif line == "#else":
            open_parts[-1] = not open_parts[-1]
        elif line == "#endif":
            open_parts.pop()
        elif all(open_parts):
            active.append(line)
    return "\n".join(active) + "\n"


def prelude(code: str) -> str:
    """Functions of prelude.c that the code calls; compilers warn of unused ones."""
    text = resources.files("etude.deploy.targets.c99").joinpath("prelude.c").read_text(encoding="utf-8")
    first, *functions = re.split(r"\n(?=/\* (?!What))", text)
    used = [f for f in functions if re.search(rf"\b{_name_of(f)}\(", code)]
    return "\n".join([first, *used])


def _name_of(function: str) -> str:
    match = re.search(r"^static (?:inline )?\w+ (\w+)\(", function, re.MULTILINE)
    assert match is not None
    return match[1]


def _answer(plan: Plan, form: CForm) -> str:
    """NAME_answer: commands of states that are numbers, nothing blended.

    Where they fade, variances are upper bounds, of which the first rows of their factors are enough inside
    of what was learned; only those that leave a command in doubt are summed to their end.
    """
    name, D, J = plan.name, len(plan.model.inputs.columns), len(plan.model.commands)
    places = {}
    at = 0
    for channel in plan.channels:
        places[channel.name] = at
        at += len(channel.parts)
    arguments = "const real *in, real *memory, int kind, real *command"
    arguments += ", real *variance" * form.deviations + ", real *safe, real *noise, int exact" * form.fade
    lines = [f"static void {name}_answer({arguments})", "{", f"    real x[{D}];"]
    if form.fade:
        lines += [f"    int loose[{J}] = {{0}};"]
    lines += [f"    real from{m}[{J}];" for m in range(len(plan.means))]
    for k, candidate in enumerate(plan.candidates):
        m = len(candidate.commands)
        lines.append(f"    real own{k}[{m}]{f', spread{k}[{m}] = {{R(0.0)}}' if form.deviations else ''};")
        if form.fade:
            lines.append(f"    real enough{k}[{m}] = {{R(0.0)}};")
    lines.append(f"    {_call(f'{name}_inputs', plan.inputs.reads, places, 'memory', 'x')};")
    held = [i for i, column in enumerate(plan.model.inputs.columns) if column[3] == "memory"]
    if held:
        lines += ["    if (kind == STILL) {", *(f"        x[{i}] = R(0.0);" for i in held), "    }"]
    begin = plan.inputs.memory
    for m, (function, code) in enumerate(plan.means.items()):
        memory_argument = [f"memory + {begin}"] if code.memory else []
        begin += code.memory
        lines += [
            # an instant by itself is at rest to what remembers, with the rates that it has
            "    if (kind != RUN)" if code.memory else "    if (kind == STILL)",
            f"        {_call(f'{function}_static', code.reads, places, f'from{m}')};",
            "    else",
            f"        {_call(function, code.reads, places, *memory_argument, f'from{m}')};",
        ]
    if not held and not plan.means:
        lines.append("    (void)kind;")
    lines += _sums(plan, form, list(plan.means))
    return "\n".join([*lines, "}", ""])


def _call(function: str, reads: tuple[str, ...], places: dict[str, int], *arguments: str) -> str:
    return f"{function}({', '.join([*(f'in + {places[read]}' for read in reads), *arguments])})"


def _sums(plan: Plan, form: CForm, means: list[str]) -> list[str]:
    """The average of the candidates, and its variance."""
    J, lines = len(plan.model.commands), []
    lines += [f"    command[{j}] = R(0.0);" for j in range(J)]
    lines += [f"    safe[{j}] = noise[{j}] = R(0.0);" for j in range(J)] if form.fade else []
    for k, candidate in enumerate(plan.candidates):
        spread = f"variance ? spread{k} : 0" if form.deviations else "0"
        lines += _variance_bounds(plan, k) if form.fade else []
        lines.append(f"    {plan.process_of[k]}(x, own{k}, {spread});")
        lines += _mark_bounded(plan, k) if form.fade else []
        safe, level = plan.safe_of[k], level_of(candidate)
        for i, j in enumerate(candidate.commands):
            weight, (offset, factor) = float(candidate.weights[i]), candidate.units[:, i]
            source = f"from{means.index(plan.mean_of[k])}[{j}]" if plan.mean_of[k] else ""
            mean = f" + {source}" if source else ""
            lines.append(f"    own{k}[{i}] = {real(offset)} + {real(factor)} * own{k}[{i}]{mean};")
            if weight:
                lines.append(f"    command[{j}] += {real(weight)} * own{k}[{i}];")
                if form.fade and safe:
                    lines.append(f"    safe[{j}] += {real(weight)} * from{means.index(safe)}[{j}];")
                elif form.fade:
                    lines.append(f"    safe[{j}] += {real(weight * float(level[i]))};")
    lines += [*(_noise(plan) if form.fade else []), *(_spreads(plan) if form.deviations else [])]
    return [*lines, *_exact_variances(plan)] if form.fade else lines


def limits(plan: Plan) -> Any:
    """(J,) what may be unknown of each command while it is as good as known: trusted in full, and not
    outside.
    """
    full, _ = thresholds(plan.model.signal_deviation, plan.model.known)
    return np.minimum(full, np.minimum(plan.model.known * (1.0 + ROUNDING), NEVER))


def _variance_bounds(plan: Plan, k: int) -> list[str]:
    """C code that bounds the variances of candidate k by its share of `limits`, plus noise at rest."""
    candidate, most, lines = plan.candidates[k], limits(plan), []
    for i, (j, pairs) in enumerate(zip(candidate.commands, rests_of(candidate), strict=True)):
        factor = float(candidate.calibration[i] * candidate.units[1, i] ** 2)
        share = SHARE * float(most[j]) / factor if candidate.weights[i] and factor else NEVER
        terms = [real(min(share, NEVER)), *(f"{real(s)} * x[{c}] * x[{c}]" for c, s in pairs)]
        lines.append(f"        spread{k}[{i}] = enough{k}[{i}] = {' + '.join(terms)};")
    unused = [i for i, weight in enumerate(candidate.weights) if not weight]
    never = [f"    spread{k}[{i}] = {real(NEVER)};" for i in unused]  # these variances are not used
    return [*never, "    if (!exact) {", *lines, "    }"]


def _exact_variances(plan: Plan) -> list[str]:
    """C code that computes exact variances for commands whose upper bound is not small enough."""
    lines = ["    {", "        int again = 0;"]
    for j, most in enumerate(limits(plan)):
        lines.append(
            f"        loose[{j}] = loose[{j}] && !(variance[{j}] - noise[{j}] <= {real(float(most))});"
        )
        lines.append(f"        again |= loose[{j}];")
    lines += ["        if (!again)", "            return;", "    }"]
    for k, candidate in enumerate(plan.candidates):
        m, used = len(candidate.commands), [i for i, weight in enumerate(candidate.weights) if weight]
        checks = {i: f"loose[{candidate.commands[i]}] && spread{k}[{i}] <= enough{k}[{i}]" for i in used}
        lines += [f"    if ({' || '.join(f'({check})' for check in checks.values())}) {{"]
        lines += [f"        real scratch[{m}], whole[{m}];"]
        for i in range(m):
            lines.append(
                f"        whole[{i}] = {checks[i] + ' ? R(0.0) : ' if i in checks else ''}{real(NEVER)};"
            )
        lines.append(f"        {plan.process_of[k]}(x, scratch, whole);")
        lines += [
            f"        if ({check})\n            spread{k}[{i}] = whole[{i}];" for i, check in checks.items()
        ]
        lines.append("    }")
    return [*lines, *_spreads(plan)]


def _mark_bounded(plan: Plan, k: int) -> list[str]:
    """C code that marks the commands whose variance may be an upper bound."""
    commands = plan.candidates[k].commands
    lines = [f"        loose[{j}] |= spread{k}[{i}] <= enough{k}[{i}];" for i, j in enumerate(commands)]
    return ["    if (!exact) {", *lines, "    }"]


def _noise(plan: Plan) -> list[str]:
    """C code of the noise part of the variance; none for commands with a positive least variance."""
    lines, least = [], plan.model.least
    for candidate in plan.candidates:
        assert candidate.process is not None
        rests = rests_of(candidate)
        for i, j in enumerate(candidate.commands):
            factor = float(candidate.weights[i] * candidate.calibration[i] * candidate.units[1, i] ** 2)
            if factor and not (least is not None and least[j] > 0.0):
                noise = real(factor * float(candidate.process.noise_variance[i]))
                terms = [noise, *(f"{real(factor * s)} * x[{c}] * x[{c}]" for c, s in rests[i])]
                lines.append(f"    noise[{j}] += {' + '.join(terms)};")
    return lines


def _spreads(plan: Plan) -> list[str]:
    model = plan.model
    lines = ["    if (variance) {", "        real apart;"]
    lines += [f"        variance[{j}] = R(0.0);" for j in range(len(model.commands))]
    for k, candidate in enumerate(plan.candidates):
        assert candidate.process is not None
        for i, j in enumerate(candidate.commands):
            weight = float(candidate.weights[i])
            if not weight:
                continue
            factor = float(candidate.calibration[i] * candidate.units[1, i] ** 2)
            noise = float(candidate.process.noise_variance[i])
            lines.append(f"        apart = own{k}[{i}] - command[{j}];")
            noisy = f"{real(factor)} * (spread{k}[{i}] + {real(noise)})"
            lines.append(f"        variance[{j}] += {real(weight)} * ({noisy} + apart * apart);")
    for j, least in enumerate(model.least if model.least is not None else []):
        if least > 0.0:
            lines.append(f"        apart = {real(least)} + command[{j}] * command[{j}];")
            lines.append(f"        variance[{j}] = variance[{j}] > apart ? variance[{j}] : apart;")
    return [*lines, "    }"]


def _functions(plan: Plan, form: CForm) -> str:
    """The functions of the header."""
    text = resources.files("etude.deploy.targets.c99").joinpath("functions.c").read_text(encoding="utf-8")
    parts = re.split(r"^/\* --- (\w+) --- \*/\n", text, flags=re.MULTILINE)
    named = dict(zip(parts[1::2], parts[2::2], strict=True))
    J, fade = len(plan.limit), form.fade
    full, none = thresholds(plan.model.signal_deviation, plan.model.known)
    declarations = f"    real variance[{J}], safe[{J}], noise[{J}];\n"
    replacements = {
        "RANGED": "" if fade else _RANGED,
        "BLENDED": named["blended"] + "\n" if fade else "",
        "NAME": plan.name,
        "UPPER": plan.name.upper(),
        "MEMORY": "state->memory" if plan.memory else "0",
        "FORGET": "    memset(state->memory, 0, sizeof state->memory);\n" if plan.memory else "",
        "OWN": declarations if fade else "",
        "KEPT": declarations.replace(f"variance[{J}], ", "") if fade else "",
        "SPARE": ", variance, safe, noise, 0" if fade else ", 0" * form.deviations,
        "BESIDE": ", safe, noise, 1" * fade,
        "BLEND": "    flags |= @NAME_blended(command, variance, safe, noise);\n" if fade else "",
        "WIDTHS": _widths(plan.model.width),
        "MEMORIES": str(max(plan.memory, 1)),
        "RATES": ", ".join(str(int(rate)) for rate in plan.still),
        "FULL": ", ".join(map(real, full)),
        "SPANS": ", ".join(map(real, none - full)),
        "KNOWN": ", ".join(real(min(v * (1.0 + ROUNDING), NEVER)) for v in plan.model.known),
        "WIDENED": real(WIDENED),
    }
    functions = "\n".join(named[part] for part in ("always", *(["variance"] if form.deviations else [])))
    holding = ["RANGED", "BLENDED", "BLEND"]  # words themselves
    order = [*holding, *sorted(replacements, key=len, reverse=True)]
    for word in dict.fromkeys(order):
        functions = functions.replace(f"@{word}", replacements[word])
    return functions


def _widths(width: Array | None) -> str:
    """C code that widens the returned variances; those of the flags stay as they are."""
    if width is None or bool((width == 1.0).all()):
        return ""
    lines = [f"        variance[{j}] *= {real(factor)};" for j, factor in enumerate(width.tolist())]
    return "\n".join(["    if (variance) {", *lines, "    }", ""])


SHARE = 0.5
"""Of what may be unknown, what variances may take of it; the rest is for candidates that differ."""
_RANGED = """\
        if (in[i] < @NAME_low[i] || in[i] > @NAME_high[i]) {
            const real wide = @WIDENED * (@NAME_high[i] - @NAME_low[i]);
            flags |= @UPPER_UNTRAINED;
            if (in[i] < @NAME_low[i] - wide || in[i] > @NAME_high[i] + wide)
                flags |= @UPPER_FAR;
        }
"""


def drag_files(inputs: Any, name: str, form: CForm) -> tuple[dict[str, bytes], Code | None]:
    """Both files of a vehicle's inputs, and the code of its drag; without the capability a drag of 0.

    Args:
        inputs: of the model; see `abilities.SupportsDrag`.
        name: prefix in C. form: numbers are float, or double.
    """
    code, (dx, dy) = None, (0.0, 0.0)
    if isinstance(inputs, SupportsDrag) and (code := inputs.drag_c(f"{name}_force")) is not None:
        dx, dy = inputs.drag[:2]
    body = _STILL.replace("@NAME@", name) if code is None else code.body
    text, _ = tables(code.data if code is not None else {}, form.single)
    conditions = {"VARIANCE": False, "SINGLE": form.single}
    lean = _template("lean.c", {"NAME": name, "UPPER": name.upper(), "DX": real(dx), "DY": real(dy)})
    remainder = f"{preprocessed(body, conditions)}\n{lean}"
    head = f"""/* {name}_lean.c: generated; {name}_lean.h describes its use. */
#include "{name}_lean.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#define VARIANCE 0

typedef {name}_real real;

"""
    source = "\n".join([head + preprocessed(prelude(remainder), conditions), text, remainder])
    header = _template("lean.h", {"NAME": name, "UPPER": name.upper()})
    return {f"{name}_lean.h": header.encode(), f"{name}_lean.c": source.encode()}, code


def _template(name: str, values: dict[str, str]) -> str:
    text = resources.files("etude.deploy.targets.c99").joinpath(name).read_text(encoding="utf-8")
    return re.sub(r"@([A-Z0-9]+)@", lambda match: values[match[1]], text)


_STILL = """\
static void @NAME@_force(const real *velocity, real *force)
{
    (void)velocity;
    force[0] = force[1] = R(0.0);
}
"""
