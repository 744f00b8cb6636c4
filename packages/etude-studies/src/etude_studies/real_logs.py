"""Recordings of real arms that models are measured on: one row each in `REAL_LOGS`.

Some come with the package, in `examples`; others may be measured but not handed on, and are read from a
folder that the user names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import etude
from etude.models import near_times, split_blocks
from etude.types import Array, Log, Mask, Samples
from etude_arm import filter_cutoff
from etude_studies.world import World

PLACES = (Path(etude.__file__).parent / "examples", Path(__file__).parents[4] / "examples")
EXAMPLES = next((place for place in PLACES if place.is_dir()), PLACES[0])
"""In a package, and in a checkout."""
QUARTERS = 4


@dataclass(frozen=True, eq=False)
class Recording:
    """A real arm's log as a campaign would learn it, divided.

    Attributes:
        world: the robot.
        train, test: blocks 3, 8, 13 and 18 of 20 are the test. Training samples within one period of the
            filter's cutoff of a test sample are left out: their filtered commands hold the test's noise.
        quarters: training and test samples with each quarter in turn as the test, with the same gap: a new
            piece of motion, where blocks lie between training ones. Empty if it is not asked.
        raw: (n, J) commands at the test samples as they were recorded, interpolated; None without a filter.
    """

    world: World
    train: Samples
    test: Samples
    raw: Array | None
    quarters: tuple[tuple[Samples, Samples], ...] = ()


@dataclass(frozen=True)
class RealLog:
    """One recording.

    Attributes:
        name: in the rows, `nmse_<name>`.
        title: robot and motion.
        licence: under which the recording was published.
        files: any one of them is looked for: below `examples` if `bundled`, else in the user's folder.
        bundled: comes with the package.
        load: from the path of the file found.
        note: what has to be said wherever its figures are shown.
    """

    name: str
    title: str
    licence: str
    files: tuple[str, ...]
    bundled: bool
    load: Callable[[Path], Recording]
    note: str = ""

    def find(self, logs: Path | None = None) -> Path | None:
        """The file, or None if it is not there."""
        folder = EXAMPLES if self.bundled else logs
        if folder is None:
            return None
        return next((folder / file for file in self.files if (folder / file).is_file()), None)


def bundled_arm(path: Path) -> Recording:
    """The log of an example, whose robot file lies beside it."""
    return recording(*_example(path))


def _example(path: Path) -> tuple[Log, World]:
    world = World.of(path.with_name(f"{path.parent.name}.toml"))
    return world.read(path), world


def arm_log(name: str, path: Path) -> tuple[Log, World]:
    """The log itself of one of `REAL_LOGS`, and its robot; SARCOS has samples without times, and no log."""
    from etude_studies.external_logs import panda_log

    return panda_log(path) if name == "panda" else _example(path)


def recording(log: Log, world: World) -> Recording:
    """A cleaned log through the default preset of a campaign, divided into blocks."""
    samples, gap = world.samples(log), 1.0 / filter_cutoff(log, world.config.data)
    train, test = split_blocks(samples, gap)
    raw = np.column_stack([np.interp(test.t, log.t, column) for column in log["command"].T])
    return Recording(world, train, test, raw, quarters(samples, gap))


def quarters(samples: Samples, gap_s: float) -> tuple[tuple[Samples, Samples], ...]:
    """Training and test samples, each quarter of one log in the order of time from the other three."""
    return tuple((samples.take(train), samples.take(test)) for train, test in quarter_masks(samples.t, gap_s))


def quarter_masks(t: Array, gap_s: float) -> Iterator[tuple[Mask, Mask]]:
    """Masks for training and test, each quarter of the times t (n,) in turn as the test."""
    place = np.argsort(np.argsort(t, kind="stable")) * QUARTERS // len(t)
    for number in range(QUARTERS):
        test = place == number
        yield ~test & ~near_times(t, test, gap_s), test


def panda(path: Path) -> Recording:
    return recording(*arm_log("panda", path))


def sarcos(path: Path) -> Recording:
    from etude_studies.external_logs import sarcos_samples

    world, samples = sarcos_samples(path)
    return Recording(world, *split_blocks(samples), raw=None)


SARCOS_NOTE = (
    "SARCOS: the official test set is the training set decimated by ten, so its rows are taken as one log "
    "and divided into blocks."
)
REAL_LOGS = (
    RealLog("ur10", "UR10, 27 s", "BSD-3-Clause", ("ur10/ur10_exciting.csv",), True, bundled_arm),
    RealLog("tx40", "Stäubli TX40, 9 s", "Apache-2.0", ("tx40/tx40_exciting.csv",), True, bundled_arm),
    RealLog("tiago", "PAL TIAGo, 80 s", "Apache-2.0", ("tiago/tiago_exciting.csv",), True, bundled_arm),
    RealLog("panda", "Franka Emika Panda, 21 s", "GPL-3.0", ("panda_exciting.npz",), False, panda),
    RealLog(
        "sarcos",
        "SARCOS arm",
        "none stated",
        ("sarcos_inv_test.npz", "sarcos_inv_test.mat"),
        False,
        sarcos,
        SARCOS_NOTE,
    ),
)
