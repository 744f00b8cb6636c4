"""What a model costs on the chip of an autopilot, by counted operations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from etude.deploy.c99.target import in_words
from etude.errors import UsageError


@dataclass(frozen=True)
class Chip:
    """A processor, and what of its time a model may take.

    Cycles are those of a counted operation with its share of loads and stores. Cortex-M4F: one cycle of VADD
    or VMUL and one of a load in a row of them (Cortex-M4 Technical Reference Manual r0p1, table 7-1: VADD and
    VMUL 1, VLDR 2, VDIV 14). An exponential counts as 24 operations, which is how this project writes it.
    Cortex-M7 issues both at once. Double on the M4F is in software, some 60 cycles an operation.

    Attributes:
        name: for people. hertz: of its clock.
        single, double: cycles of one operation in float and double.
        share: of its time that asking the model may take.
    """

    name: str
    hertz: float
    single: float
    double: float
    share: float

    def seconds(self, operations: int, *, single: bool) -> float:
        """Of so many operations."""
        return operations * (self.single if single else self.double) / self.hertz


M4F = Chip("Cortex-M4F at 168 MHz", 168e6, 2.0, 60.0, 0.15)
"""STM32F405 of the Crazyflie; the stabilizer and the estimator take the rest."""
M7 = Chip("Cortex-M7 at 216 MHz", 216e6, 1.0, 3.0, 0.25)
"""STM32F765 of an FMUv5 board."""


def chosen_rate(
    chip: Chip,
    operations: int,
    rates: tuple[int, ...],
    asked: float | None,
    *,
    single: bool,
    lighter: Sequence[str] = (),
) -> float:
    """Hz at which the model is asked: what was asked for, else the largest of `rates` that the chip can do.

    Args:
        single: whether numbers are float. lighter: what would take less, in words.

    Raises:
        UsageError: it takes more of the chip's time than it may, at that rate or at every one.
    """
    seconds = chip.seconds(operations, single=single)
    fitting = [rate for rate in rates if seconds * rate <= chip.share]
    if asked is not None and asked not in rates:
        raise UsageError(
            f"the model is asked at {', '.join(map(str, rates))} Hz, not {asked:g}", where="--rate"
        )
    wanted = max(fitting, default=0) if asked is None else int(asked)
    if wanted in fitting:
        return float(wanted)
    at = min(rates) if asked is None else asked
    ways = [f"export --rate {max(fitting)}"] if fitting else []
    ways += [] if single else ["export --real float"]
    raise UsageError(
        f"one answer takes about {1e3 * seconds:.2g} ms on a {chip.name}, {100 * seconds * at:.0f} % of its "
        f"time at {at:g} Hz; the model may take {100 * chip.share:.0f} %",
        next_step=in_words([*ways, *lighter]),
    )


def cost_in_words(chip: Chip, operations: int, rate: float, *, single: bool) -> str:
    """A sentence: how long, how often, and by what count."""
    seconds = chip.seconds(operations, single=single)
    cycles = chip.single if single else chip.double
    return (
        f"One answer (motion, hover, drag: {operations:,} operations of {cycles:g} cycles) takes about "
        f"{1e6 * seconds:.0f} us on a {chip.name}; at {rate:g} Hz that is {100 * seconds * rate:.1f} % of it."
    )
