"""`etude export --to px4|crazyflie`: a vehicle's model in C, states made of set-points, and the glue."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

from etude._runtime.options import taken
from etude.deploy.targets.c99.header import CForm
from etude.deploy.targets.c99.plan import Plan
from etude.deploy.targets.c99.source import drag_files
from etude.deploy.targets.c99.target import BARE, Files, cheaper_options, checked_files, options_sentence
from etude.errors import UsageError
from etude.protocols import Kind
from etude.types import Delivered
from etude_quadrotor.spec import QuadrotorSpec

CRAZYFLIE_MOTORS = 4  # the firmware of other airframes has its own mixer
OUTSIDE = "Far outside the training data the last good addition fades out within 0.2 s."
READS: Mapping[str, Sequence[str]] = {
    "altitude": ("asked->altitude",),
    "specific_force": ("dot(x, push)", "dot(y, push)", "dot(z, push)"),
    "rates": ("rates[0]", "rates[1]", "rates[2]"),
    "angular_acceleration": ("next->turning[0]", "next->turning[1]", "next->turning[2]"),
    "body_velocity": ("dot(x, velocity)", "dot(y, velocity)", "dot(z, velocity)"),
    "body_acceleration": ("dot(x, acceleration)", "dot(y, acceleration)", "dot(z, acceleration)"),
    "battery_voltage": ("asked->battery",),
}
"""Channels of a vehicle that flight.c computes from a set-point; body frame x forward, y left, z up."""
HOVERS: Mapping[str, Sequence[str]] = {
    "altitude": ("asked->altitude",),
    "specific_force": ("R(0.0)", "R(0.0)", "GRAVITY"),
    "battery_voltage": ("asked->battery",),
}
"""Those that are not 0 in hover."""
RATES = (100, 250, 500)
"""Hz at which a model may be asked: they divide the 1,000 of a Crazyflie's stabilizer."""


@dataclass(frozen=True)
class FlightOptions:
    """See `commands.export`; rate: Hz at which the model is asked; None: as fast as the chip can."""

    real: str = "float"
    single: bool = False
    rate: float | None = None
    name: str = ""
    model_hash: str = ""


@dataclass(frozen=True)
class Chip:
    """A processor, and the share of its time for a model.

    Cycles are those of a counted operation with its share of loads and stores. Cortex-M4F: one cycle of VADD
    or VMUL and one of a load in a row of them (Cortex-M4 Technical Reference Manual r0p1, table 7-1: VADD and
    VMUL 1, VLDR 2, VDIV 14). An exponential counts as 24 operations, which is how this project writes it.
    Cortex-M7 issues both at once. Double on the M4F is in software, some 60 cycles an operation.

    Attributes:
        name: for people. hertz: of its clock.
        single, double: cycles of one operation in float and double.
        share: of its time for evaluations of the model.
    """

    name: str
    hertz: float
    single: float
    double: float
    share: float

    def seconds(self, operations: int, *, single: bool) -> float:
        """s for this number of operations."""
        return operations * (self.single if single else self.double) / self.hertz


M4F = Chip("Cortex-M4F at 168 MHz", 168e6, 2.0, 60.0, 0.15)
"""STM32F405 of the Crazyflie; the stabilizer and the estimator take the rest."""
M7 = Chip("Cortex-M7 at 216 MHz", 216e6, 1.0, 3.0, 0.25)
"""STM32F765 of an FMUv5 board."""


def chosen_rate(
    chip: Chip,
    operations: int,
    rates: tuple[int, ...],
    requested: float | None,
    *,
    single: bool,
    cheaper: Sequence[str] = (),
) -> float:
    """Hz of evaluations of the model: the requested rate, else the largest of `rates` that the chip can
    sustain.

    Args:
        single: whether numbers are float. cheaper: options that need less computing time.

    Raises:
        UsageError: the model exceeds its share of the chip's time at that rate, or at every rate.
    """
    seconds = chip.seconds(operations, single=single)
    fitting = [rate for rate in rates if seconds * rate <= chip.share]
    if requested is not None and requested not in rates:
        raise UsageError(
            f"the model is evaluated at {', '.join(map(str, rates))} Hz, not {requested:g}", where="--rate"
        )
    selected = max(fitting, default=0) if requested is None else int(requested)
    if selected in fitting:
        return float(selected)
    at = min(rates) if requested is None else requested
    ways = [f"export --rate {max(fitting)}"] if fitting else []
    ways += [] if single else ["export --real float"]
    raise UsageError(
        f"one answer takes about {1e3 * seconds:.2g} ms on a {chip.name}, {100 * seconds * at:.0f} % of its "
        f"time at {at:g} Hz; the model may take {100 * chip.share:.0f} %",
        next_step=options_sentence([*ways, *cheaper]),
    )


def cost_in_words(chip: Chip, operations: int, rate: float, *, single: bool) -> str:
    """A sentence: how long, how often, and by what count."""
    seconds = chip.seconds(operations, single=single)
    cycles = chip.single if single else chip.double
    return (
        f"One answer (motion, hover, drag: {operations:,} operations of {cycles:g} cycles) takes about "
        f"{1e6 * seconds:.0f} us on a {chip.name}; at {rate:g} Hz that is {100 * seconds * rate:.1f} % of it."
    )


@dataclass(frozen=True)
class Autopilot:
    """A `protocols.Target`: the glue of one autopilot.

    Attributes:
        name: of the target. sources: templates and their file names.
        chip: the processor. rounds: iterations for the drag in flight.c.
    """

    name: str
    sources: Mapping[str, str]
    chip: Chip
    rounds: int

    def __call__(self, model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:
        """The model's C, NAME_flight.h and .c, and the glue.

        Raises:
            UsageError: unknown options; commands that are not its motors or not parts of full scale; an input
                that no set-point determines; a model without C code; float where its error is too large.
        """
        settings = taken(options, FlightOptions, self.name)
        form = CForm(settings.real == "float", fade=False, digest=settings.model_hash)
        made, sentences, facts = checked_files(model, kind, spec, form, settings.name, settings.single)
        lean, drag = drag_files(made.plan.model.inputs, made.plan.name, form)
        # one call evaluates the motion and hover, and iterates the drag as often as flight.c does
        operations = 2 * made.plan.operations(form.deviations)
        operations += 0 if drag is None else self.rounds * drag.operations[0]
        less = cheaper_options(made.plan, form)
        rate = chosen_rate(self.chip, operations, RATES, settings.rate, single=form.single, cheaper=less)
        cost = cost_in_words(self.chip, operations, rate, single=form.single)
        placeholders = _placeholders(made, self.name, rate, spec)
        files = {**made.files, **lean}
        for template, place in self.sources.items():
            files[place.replace("@NAME@", made.plan.name)] = _filled(template, placeholders)
        order = ", ".join(
            f"{n} is {int(m) + 1}"
            for n, m in zip(model.commands, placeholders["MOTORS"].split(", "), strict=True)
        )
        facts |= {"rate": rate, "operations_of_an_answer": operations}
        notes = [
            sentence for sentence in sentences if sentence != BARE
        ]  # not chosen by the user: the glue terminates it itself
        return Delivered(files, (f"Motors of {self.name}: {order}.", *notes, OUTSIDE, cost), facts)


SHARED = {"flight.h": "@NAME@_flight.h", "flight.c": "@NAME@_flight.c"}
PX4 = Autopilot("px4", {**SHARED, "px4.h": "@NAME@_px4.h", "px4.c": "@NAME@_px4.c"}, M7, 3)
CRAZYFLIE = Autopilot("crazyflie", {**SHARED, "crazyflie.c": "controller_@NAME@.c"}, M4F, 1)


def _placeholders(made: Files, target: str, rate: float, spec: QuadrotorSpec) -> dict[str, str]:
    plan, single_precision = made.plan, made.form.single
    return {
        "NAME": plan.name,
        "UPPER": plan.name.upper(),
        "WORD": "uint32_t" if single_precision else "uint64_t",
        "F": "f" if single_precision else "",
        "MASK": "0x7f800000u" if single_precision else "0x7ff0000000000000u",
        "FILL": "\n".join(_fill(plan, "own->input", READS, "    ")),
        "HOVER": "\n".join(_fill(plan, "hover", HOVERS, "    ")),
        "MOTORS": ", ".join(map(str, _motors(plan, target))),
        "RATE": f"{rate:.0f}",
        "LATE": f"{1.0 / spec.attitude_gain:.6f}",
        "DAMPING": f"{spec.velocity_damping:.6f}",
    }


def _fill(plan: Plan, into: str, told_by: Mapping[str, Sequence[str]], indent: str) -> list[str]:
    """Statements that set what the model reads."""
    lines = []
    for i, (channel, part) in enumerate(plan.parts):
        if channel.name not in READS:
            raise UsageError(
                f"the model reads {channel.name}, which set-points do not contain",
                next_step="Train it without, or export --to c.",
            )
        if channel.name in told_by:
            lines.append(f"{indent}{into}[{i}] = {told_by[channel.name][part]};")
    return lines


def _motors(plan: Plan, target: str) -> list[int]:
    """The motor of each command, from 0: names of commands end in the autopilot's numbers, from 1."""
    if target == CRAZYFLIE.name and len(plan.units) != CRAZYFLIE_MOTORS:
        raise UsageError(f"a Crazyflie has {CRAZYFLIE_MOTORS} motors, this vehicle has {len(plan.units)}")
    if set(plan.units) - {"1", ""}:
        raise UsageError(
            f"{target} needs fractions of full scale, but commands are in "
            f"{', '.join(dict.fromkeys(plan.units))}",
            next_step='Learn from set-points of the motors, with command_unit = "1"; or export --to c.',
        )
    matches = [re.search(r"(\d+)$", name) for name in plan.model.commands]
    numbers = [int(match[1]) - 1 for match in matches if match]
    if sorted(numbers) != list(range(len(matches))):
        raise UsageError(
            f"the motors cannot be identified by {', '.join(plan.model.commands)}",
            next_step=f"Let commands in robot.toml end in {target}'s numbers of the motors: m1, m2, m3, ...",
        )
    return numbers


def _filled(template: str, placeholders: Mapping[str, str]) -> bytes:
    place = resources.files("etude_quadrotor.export").joinpath("sources", template)
    text = place.read_text(encoding="utf-8")
    return re.sub(r"@([A-Z0-9]+)@", lambda match: placeholders[match[1]], text).encode()
