"""`etude export --to c`: the model as one header and one source file of C99, a test and a CMake file."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from etude._runtime.options import taken
from etude.deploy.model_states import log_of, outside_training_sentence
from etude.deploy.targets.c99.header import CForm, header
from etude.deploy.targets.c99.plan import Plan, parts_in_c, planned, process_code, renamed
from etude.deploy.targets.c99.self_test import EXACT, SOURCE, float_tolerance, golden_vectors, self_test
from etude.deploy.targets.c99.source import drag_files, source
from etude.errors import EtudeError, UsageError
from etude.models.learned_model import LearnedModel
from etude.models.process_abilities import EnsembleMember
from etude.protocols import Kind
from etude.types import Array, Delivered

REALS = ("double", "float")
USUAL = 1000.0
"""Hz of a control loop, with which times are compared if no rate is given."""
CLOCK = 1e9
"""Operations a second that times are estimated with: a core of 1 GHz, one operation in each cycle."""
ROUNDED = 1e-6
"""Largest deviation in double that can be rounding: exponents are made of differences in C, and of squares in
Python."""
LARGEST = 64 * 2**20
"""Bytes of tables beyond which nobody compiles them."""


BARE = "WARNING: --no-fade: commands are the posterior mean, also outside the training data."


def single_member(model: LearnedModel) -> LearnedModel:
    """The model with, for each command, the candidate of most weight: the best held-out density."""
    weights = np.zeros((len(model.candidates), len(model.commands)))
    for k, candidate in enumerate(model.candidates):
        weights[k, list(candidate.commands)] = candidate.weights
    best = weights.argmax(axis=0)
    selected = [
        np.array([float(best[j] == k) for j in candidate.commands])
        for k, candidate in enumerate(model.candidates)
    ]
    return replace(
        model,
        candidates=tuple(replace(c, weights=w) for c, w in zip(model.candidates, selected, strict=True)),
    )


def errors(model: LearnedModel) -> str:
    """Held-out errors of the candidates in use, in words."""
    by_command: dict[str, Array] = {}
    for candidate in model.candidates:
        own_errors = candidate.error if isinstance(candidate, EnsembleMember) else None
        for i, j in enumerate(candidate.commands):
            if candidate.weights[i] and own_errors is not None:
                by_command[model.commands[j]] = own_errors[i]
    if not by_command:
        return "its held-out error was not stored with this model; train it again"
    each = ", ".join(f"{name} {float(value):.3g}" for name, value in by_command.items())
    return f"mean absolute error on held-out motion: {each}"


@dataclass(frozen=True)
class COptions:
    """See `commands.export`."""

    real: str = "double"
    variance: bool = False
    fade: bool = True
    single: bool = False
    rate: float | None = None
    name: str = ""
    model_hash: str = ""


@dataclass(frozen=True, eq=False)
class Files:
    """The files of a model, and what they were made of: for targets that stand around them.

    Attributes:
        plan: states and commands in order, with ranges. form: what was asked for.
        files: by name. tables: bytes of the static tables.
    """

    plan: Plan
    form: CForm
    files: Mapping[str, bytes]
    tables: int


def c_files(
    model: LearnedModel, kind: Kind, spec: Any, form: CForm, name: str = "", small: float = EXACT
) -> Files:
    """NAME.h, NAME.c, NAME_test.c and CMakeLists.txt.

    Args:
        small: deviation from Python, as a part of a command's limit, that its test allows in double.

    Raises:
        UsageError: a part of the model has no C code, named; or the tables are too large.
    """
    plan = planned(model, kind, spec, name)
    text, tables = source(plan, form)
    if tables > LARGEST:
        raise UsageError(
            f"the tables take {tables / 2**20:.0f} MiB, more than the limit of {LARGEST // 2**20} MiB",
            next_step=options_sentence(cheaper_options(plan, form)),
        )
    vectors = golden_vectors(plan, single=form.single, fade=form.fade)
    files = {
        f"{plan.name}.h": header(plan, form),
        f"{plan.name}.c": text,
        f"{plan.name}_test.c": self_test(plan, form, vectors, small),
        "CMakeLists.txt": _CMAKE.replace("@NAME", plan.name),
    }
    return Files(plan, form, {file: content.encode() for file, content in files.items()}, tables)


FEWER_POINTS = (
    "model.points in campaign.toml, then etude learn; where a model is in use, then etude promote with "
    '--force --reason "fewer points"'
)


def cheaper_options(plan: Plan, form: CForm) -> tuple[str, ...]:
    """Options that would make this export cheaper."""
    options = ["export --no-fade"] if form.fade and not form.variance else []
    options += ["export --single"] if plan.averages else []
    return (*options, f"learn with fewer points ({FEWER_POINTS})")


def options_sentence(ways: Sequence[str]) -> str:
    """Sentence on these options."""
    text = ", or ".join(ways)
    return f"{text[0].upper()}{text[1:]}."


def C99(model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:
    """The target (`protocols.Target`).

    Raises:
        UsageError: unknown options, what cannot be exported, or float where it would be wrong.
    """
    settings = taken(options, COptions, "c")
    if settings.real not in REALS:
        raise UsageError(f"numbers are {' or '.join(REALS)}, not {settings.real!r}")
    form = CForm(settings.real == "float", settings.variance, settings.fade, settings.model_hash)
    timing = Timing(settings.rate, USUAL)
    made, sentences, facts = checked_files(model, kind, spec, form, settings.name, settings.single, timing)
    lean, drag = drag_files(model.inputs, made.plan.name, form)
    if drag is None:
        return Delivered(made.files, sentences, facts)
    name = made.plan.name
    cmake = made.files["CMakeLists.txt"].replace(f" {name}.c)".encode(), f" {name}.c {name}_lean.c)".encode())
    sentence = f"{name}_lean.h: accelerations to add, to compensate the learned drag."
    return Delivered({**made.files, **lean, "CMakeLists.txt": cmake}, (*sentences, sentence), facts)


COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2")
DEVIATION = re.compile(r"largest deviation: (\S+) .*; (\d+) wrong")
LONGEST_S = 300.0  # that a compiler may take for large tables


@dataclass(frozen=True)
class Built:
    """Result of the build and of its test.

    Attributes:
        compiler: with which. deviation: largest, as a part of a command's limit. wrong: flags that differ.
        code: bytes of the machine code without tables; 0 where nothing tells.
    """

    compiler: str
    deviation: float
    wrong: int
    code: int


def compiler() -> str:
    """This machine's C compiler; "" if there is none."""
    return next((name for name in COMPILERS if shutil.which(name)), "")


def built(name: str, files: Mapping[str, bytes], tables: int) -> Built | None:
    """The files built and their test run; None where there is no compiler.

    Raises:
        EtudeError: they do not compile, or the test does not end as it should.
    """
    cc = compiler()
    if not cc:
        return None
    with tempfile.TemporaryDirectory(prefix="etude-c99-") as place:
        folder = Path(place)
        for file, data in files.items():
            (folder / file).write_bytes(data)
        _run([cc, *FLAGS, "-c", f"{name}.c", "-o", f"{name}.o"], folder)
        _run([cc, *FLAGS, f"{name}_test.c", f"{name}.o", "-lm", "-o", "self_test"], folder)
        match = DEVIATION.search(_run(["./self_test"], folder, good=(0, 1)))
        if match is None:
            raise EtudeError(
                "the self-test of the exported model printed no result", next_step="Please report it."
            )
        return Built(cc, float(match[1]), int(match[2]), max(_code_size(folder / f"{name}.o") - tables, 0))


def _run(command: list[str], folder: Path, good: tuple[int, ...] = (0,)) -> str:
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, timeout=LONGEST_S
        )
    except subprocess.TimeoutExpired:
        raise EtudeError(
            f"{command[0]} did not finish the exported model within {LONGEST_S:g} s",
            next_step="Export again when this machine has less load, or with --single, which needs fewer "
            "tables.",
        ) from None
    if done.returncode not in good:
        raise EtudeError(
            f"{command[0]} cannot compile the exported model: {done.stderr.strip()[-400:]}",
            next_step="Please report it, with the compiler's version.",
        )
    return done.stdout


def _code_size(path: Path) -> int:
    """Bytes of code and constant tables of an object file."""
    if not shutil.which("size"):
        return 0
    lines = _run(["size", path.name], path.parent).splitlines()
    return int(lines[1].split()[0]) if len(lines) > 1 else 0


@dataclass(frozen=True)
class Timing:
    """Rates of calls, Hz.

    Attributes:
        required: a call must be done within its period; None: no requirement.
        usual: times are compared with it if none is required; 0: with none.
    """

    required: float | None = None
    usual: float = 0.0


def checked_files(
    model: LearnedModel,
    kind: Kind,
    spec: Any,
    form: CForm,
    name: str = "",
    alone: bool = False,
    timing: Timing = Timing(),
) -> tuple[Files, tuple[str, ...], dict[str, Any]]:
    """The files, compared with Python by this machine's compiler if it has one; sentences and facts of them.

    Args:
        alone: the best candidate of each command alone; also where only that keeps a required rate.

    Raises:
        UsageError: what cannot be exported, a rate that nothing keeps, or float where it would be wrong.
        EtudeError: the C is wrong.
    """
    required = timing.required
    if required is not None and not required > 0.0:
        raise UsageError(f"a rate must be above 0 Hz, not {required}", where="--rate")
    rate = float(required or timing.usual)
    best = single_member(model)
    whole, least = (_seconds(one, form, form.fade) for one in (model, best))
    fitted = required is not None and not alone and least <= 1.0 / rate < whole
    chosen = best if alone or fitted else model
    made = c_files(chosen, kind, spec, form, name)
    if required is not None and _call(made) > 1.0 / rate:
        raise UsageError(
            f"one call takes {_time_in_words(made)}, more than the {1e6 / rate:.0f} us at {rate:g} Hz",
            where="--rate",
            next_step=" ".join([*_what_takes_less(made, model, rate), UNTIMED]),
        )
    build = built(made.plan.name, made.files, made.tables)
    if form.single:
        _require_right(build, made.plan)
    elif build is not None and build.deviation > EXACT:
        made = c_files(chosen, kind, spec, form, name, _rounding(build))
    sentences = [*_names(made.plan), _outside(made), *_sizes(made, build), *_times(made, model, rate)]
    if fitted:
        sentences.append(
            f"All candidates take {1e6 * whole:.0f} us: so only the best member of each command is written."
        )
    if alone or fitted:
        sentences += _differences(made, model)
    return made, (*sentences, _checked(build)), _facts(made, build)


def _differences(made: Files, model: LearnedModel) -> list[str]:
    """Sentence on how far the best candidates alone are from all of them, within the training ranges."""
    plan, fade = made.plan, made.form.fade
    states = golden_vectors(plan, fade=fade).inputs
    inside = ((states >= plan.low) & (states <= plan.high)).all(axis=1)
    log = log_of(plan.channels, states, SOURCE)
    whole, written = (one.predict(log, fade=fade).mean[inside] for one in (model, plan.model))
    if not inside.any() or np.array_equal(whole, written):
        return []
    names = zip(model.commands, plan.units, np.abs(whole - written).max(axis=0).tolist(), strict=True)
    most = ", ".join(f"{name} {size:.2g} {unit}" for name, unit, size in names)
    return [
        f"etude predict averages the candidates. Within the training ranges this differs by up to {most}."
    ]


def _require_right(build: Built | None, plan: Plan) -> None:
    if build is None:
        raise UsageError(
            "only a test with a C compiler shows whether float is accurate enough, and there is no compiler",
            next_step="apt-get install -y gcc, or export double.",
        )
    most = float_tolerance(plan)
    if build.deviation > most or build.wrong:
        raise UsageError(
            "float is not accurate enough for this model: commands differ from Python's by up to "
            f"{build.deviation:.1e} of their limit on the golden vectors, more than {most:.2g}, a tenth "
            "of their noise or 1e-4",
            next_step="Export double; or train with more noise (model.noise_floor) or fewer points.",
        )


def _rounding(build: Built) -> float:
    """What the test of such a model allows: Python's sums of squares round more where lengths are tiny.

    Raises:
        EtudeError: it differs by more than rounding may.
    """
    if build.deviation > ROUNDED or build.wrong:
        raise EtudeError(
            f"the exported C differs from Python by {build.deviation:.1e} of a command's limit",
            next_step="Do not use it; please report it with the model.",
        )
    return 10.0 * build.deviation


def _names(plan: Plan) -> list[str]:
    states, commands = parts_in_c(plan)
    lines = [*renamed(plan.labels, states), *renamed(list(plan.model.commands), commands)]
    return [f"Names that C does not allow: {'; '.join(lines)}."] if lines else []


def _outside(made: Files) -> str:
    """Sentence on the commands outside the training data."""
    if not made.form.fade:
        return BARE
    return f"Outside: {outside_training_sentence(made.plan.model)}"


def _sizes(made: Files, build: Built | None) -> list[str]:
    facts = _facts(made, build)
    code = f" and {facts['code_bytes'] / 1024:.1f} KB of code" if facts["code_bytes"] else ""
    stack = f"about {facts['stack_bytes'] / 1024:.1f} KB of stack"
    return [
        f"Flash: {made.tables / 1024:.1f} KB of tables{code}.",
        f"RAM: {facts['state_bytes']} bytes of state, {stack}.",
        f"At worst {facts['operations']:,} operations in one call.",
    ]


UNTIMED = "Your core may be faster: export without --rate and measure the time there."


def _call(made: Files) -> float:
    """s of one call at worst, on a core as `CLOCK`."""
    return made.plan.operations(made.form.deviations, made.form.fade) / CLOCK


def _time_in_words(made: Files) -> str:
    return f"about {1e6 * _call(made):.0f} us on a 1 GHz core with one operation per cycle"


def _times(made: Files, model: LearnedModel, rate: float) -> list[str]:
    """Sentences on the worst-case time against the rate, and on cheaper options."""
    if not rate:
        return []
    line, part = f"One call takes {_time_in_words(made)}", _call(made) * rate
    if part <= 1.0:
        return [f"{line}: {100 * part:.0f} % of the time at {rate:g} Hz."]
    return [
        f"WARNING: {line}, more than the {1e6 / rate:.0f} us at {rate:g} Hz.",
        *_what_takes_less(made, model, rate),
    ]


def _what_takes_less(made: Files, model: LearnedModel, rate: float) -> list[str]:
    """Sentence on the remaining options."""
    lines, best, form = [], single_member(model), made.form
    if made.plan.averages:
        alone = 1e6 * _seconds(best, form, form.fade)
        lines.append(f"--single uses only the best member: about {alone:.0f} us; {errors(best)}.")
    if form.fade and not form.variance:
        least, both = 1e6 * made.plan.operations(False) / CLOCK, 1e6 * _seconds(best, form, False)
        also = f", with --single about {both:.0f} us" if made.plan.averages else ""
        lines.append(
            f"--no-fade takes about {least:.0f} us{also}; commands outside the training data are then "
            "inaccurate."
        )
    if form.deviations:
        part = math.ceil(math.sqrt(_call(made) * rate))
        lines.append(
            f"Time grows with the square of the number of points: train with 1/{part} ({FEWER_POINTS})."
        )
    return lines


def _seconds(model: LearnedModel, form: CForm, fade: bool) -> float:
    """Of one call at worst, of the processes alone, on a core as `CLOCK`."""
    deviations = fade or form.variance
    owners = {id(c.process): c for c in model.candidates if c.weights.any() and c.process is not None}
    codes = [process_code(one, f"p{number}") for number, one in enumerate(owners.values())]
    operations = sum(sum(code.operations[: 1 + deviations]) for code in codes)
    return operations * (1 + fade) / CLOCK  # as `Plan.operations`: in doubt it asks twice


def _checked(build: Built | None) -> str:
    if build is None:
        return "Not compiled here, because there is no C compiler. Build and run its test on another machine."
    return f"Built with {build.compiler}; its test differs from Python by {build.deviation:.1e} of a limit."


def _facts(made: Files, build: Built | None) -> dict[str, Any]:
    plan, size = made.plan, 4 if made.form.single else 8
    work = (
        max((code.work for code in plan.codes), default=0)
        + 4 * len(plan.low)
        + len(plan.model.inputs.columns)
    )
    return {
        "name": plan.name,
        "real": made.form.real,
        "tables_bytes": made.tables,
        "code_bytes": 0 if build is None else build.code,
        "state_bytes": size * (len(plan.low) + plan.memory),
        "stack_bytes": size * work,
        "operations": plan.operations(made.form.deviations, made.form.fade),
        "deviation": None if build is None else build.deviation,
    }


_CMAKE = """\
cmake_minimum_required(VERSION 3.10)
project(@NAME C)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_STANDARD_REQUIRED ON)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library(@NAME STATIC @NAME.c)
target_include_directories(@NAME PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
if(UNIX)
  target_link_libraries(@NAME PUBLIC m)
endif()

enable_testing()
add_executable(@NAME_test @NAME_test.c)
target_link_libraries(@NAME_test @NAME)
add_test(NAME @NAME COMMAND @NAME_test)
"""
