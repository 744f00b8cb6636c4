"""`etude bench c99`: what one call of the exported C takes on this machine, and how fast it moves its tables.

Built with the first of gcc, clang and cc at `-O3 -ffast-math -march=native`; each figure is the least of many
batches of calls with inputs that change, since a busy machine only adds. Beside the means stands onnxruntime
with one thread on the graph of `--to onnx`, where it is installed (`pip install '.[onnx]'`).
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from etude.deploy import CForm, Files, c_files, graph_inputs, parts_of, session, written
from etude.errors import UsageError
from etude.types import Array
from etude_studies.c99_models import Sized, sized
from etude_studies.rows import Row, rows_json, table

FLAGS = ("-std=c99", "-O3", "-ffast-math", "-march=native")
MAIN = """
#define _POSIX_C_SOURCE 199309L
#include "NAME.h"
#include <stdio.h>
#include <time.h>
static const NAME_real rows[COUNT][UPPER_INPUTS] = {ROWS};
int main(void)
{
    NAME_state state;
    NAME_real input[UPPER_INPUTS], command[UPPER_COMMANDS], variance[UPPER_COMMANDS], sum = 0;
    double best = 1e9;
    int batch, call, i;
    NAME_init(&state);
    (void)variance;
    for (batch = 0; batch < BATCHES; ++batch) {
        struct timespec begin, end;
        double taken;
        clock_gettime(CLOCK_MONOTONIC, &begin);
        for (call = 0; call < CALLS; ++call) {
            for (i = 0; i < UPPER_INPUTS; ++i)
                input[i] = rows[(call * 7 + batch) % COUNT][i];
            ASKED;
            sum += command[0];
        }
        clock_gettime(CLOCK_MONOTONIC, &end);
        taken = (end.tv_sec - begin.tv_sec) * 1e6 + (end.tv_nsec - begin.tv_nsec) * 1e-3;
        best = taken / CALLS < best ? taken / CALLS : best;
    }
    printf("us %.4f %g\\n", best, (double)sum);
    return 0;
}
"""
BATCHES, CALLS = 200, 20


@dataclass(frozen=True)
class Case:
    """One line: a model, and what may be asked of it in µs, double and float (None: no bar).

    fade: its commands fade. apart: how far between its points it is asked, in their half ranges; 0 is among
    them, where variances are soon known to be small, and from 3 on they are summed to their end.
    """

    name: str
    member: str
    joints: int
    points: int
    variance: bool
    bars: tuple[float | None, float | None]
    fade: bool = False
    apart: float = 0.5


CASES = (
    Case("mean", "ard_se", 4, 500, False, (12.0, 4.0)),
    Case("mean_variance", "ard_se", 4, 500, True, (200.0, 100.0)),
    Case("faded_trained", "ard_se", 4, 500, False, (None, None), fade=True, apart=0.0),
    Case("faded_outside", "ard_se", 4, 500, False, (None, None), fade=True, apart=4.0),
    Case("ssgp_mean", "ssgp", 4, 500, False, (5.0, 2.2)),
    Case("default_mean", "structured", 7, 600, False, (200.0, None)),
)


def run(*, json: bool = False, seed: int = 0, quick: bool = False) -> list[Row]:
    """Measures all cases and prints the rows; `quick` leaves out the variances."""
    rows = []
    for case in CASES:
        if quick and (case.variance or case.fade):
            continue
        learned = sized(case.member, case.joints, case.points, seed)
        for single, bar in zip((False, True), case.bars, strict=True):
            rows += _measured(case, learned, single, bar)
    rows += _beside_onnx(sized("ard_se", 4, 500, seed), rows)
    if json:
        print(rows_json(rows, f"etude bench c99 --seed {seed}{' --quick' * quick}"))  # noqa: T201
    else:
        table(rows, "One call of the exported C")
    return rows


def _measured(case: Case, learned: Sized, single: bool, bar: float | None) -> list[Row]:
    made = c_files(
        learned.model, learned.kind, learned.spec, CForm(single, case.variance, fade=case.fade), "bench"
    )
    us = microseconds(made, case.variance, _rows(learned, case.apart))
    kind = "float" if single else "double"
    name = f"{case.name}_{kind}"
    gigabytes = made.tables / us * 1e-3
    return [
        Row(f"{name}_us", us, "us", "" if bar is None else "bar", bar),
        Row(f"{name}_tables_kb", made.tables / 1024.0, "KB"),
        Row(f"{name}_rate", gigabytes, "GB/s"),
    ]


COUNT = 97
"""Rows that are asked in turn."""


def _rows(learned: Sized, apart: float) -> Array:
    """(COUNT, N) inputs of the C: points of the first process, which are its states, or others among them."""
    process: Any = learned.model.candidates[0].process
    width = 3 * len(learned.model.commands)
    if not apart:
        return np.asarray(process.own[0].X[:COUNT, :width])
    k, i = np.arange(COUNT)[:, None], np.arange(width)
    return np.asarray(2.0 * apart * ((k + 13 * i) % 101 * 0.01 - 0.5))


def compiler() -> str:
    """The compiler to measure with. UsageError if there is none."""
    for name in ("gcc", "clang", "cc"):
        if shutil.which(name):
            return name
    raise UsageError("there is no C compiler to measure with", next_step="apt-get install -y gcc")


def microseconds(made: Files, variance: bool, rows: Array) -> float:
    """Of one call, asked at rows (COUNT, N) of inputs."""
    name = made.plan.name
    call = (
        f"{name}_predict(&state, input, command, variance)"
        if variance
        else f"{name}_mean(&state, input, command)"
    )
    placeholders = {
        "NAME": name,
        "UPPER": name.upper(),
        "ASKED": call,
        "BATCHES": str(BATCHES),
        "CALLS": str(CALLS),
        "COUNT": str(COUNT),
        "ROWS": ", ".join("{" + ", ".join(map(repr, row)) + "}" for row in rows.tolist()),
    }
    main = MAIN
    for word, value in placeholders.items():
        main = main.replace(word, value)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for file, data in made.files.items():
            (folder / file).write_bytes(data)
        (folder / "main.c").write_text(main, encoding="utf-8")
        command = [compiler(), *FLAGS, f"{name}.c", "main.c", "-lm", "-o", "timed"]
        subprocess.run(command, cwd=folder, check=True)
        output = subprocess.run(["./timed"], cwd=folder, check=True, capture_output=True, text=True).stdout
    match = re.search(r"us (\S+)", output)
    assert match is not None
    return float(match[1])


def _beside_onnx(learned: Sized, rows: list[Row]) -> list[Row]:
    """onnxruntime on the same mean, if it is installed."""
    try:
        import onnx  # noqa: F401
        import onnxruntime  # noqa: F401
    except ImportError:
        return []
    mean = {row.metric: row.value for row in rows}
    onnx_rows, parts = [], parts_of(learned.model)
    widths = graph_inputs(parts, learned.kind.channels(learned.spec)).widths
    for kind, dtype in (("double", np.float64), ("float", np.float32)):
        ask = session(written(parts, widths, dtype, variance=False, fade=False))
        x = np.full((1, learned.model.ranges.shape[1]), 0.1, dtype=dtype)
        best = np.inf
        for _ in range(BATCHES):
            begin = time.perf_counter()
            for _ in range(CALLS):
                ask(x)
            best = min(best, (time.perf_counter() - begin) / CALLS * 1e6)
        onnx_rows.append(Row(f"onnxruntime_mean_{kind}_us", best, "us", "C", mean[f"mean_{kind}_us"]))
    return onnx_rows
