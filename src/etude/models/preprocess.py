"""From logs to data sets: inputs, filter, trimming, stick mask and thinning. This step decides the error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.logs.derivatives import (
    Smoothed,
    auto_cutoff,
    median_rate,
    resample,
    segments,
    smooth,
    uniform_grid,
)
from etude.logs.log import RobotLog
from etude.models.dataset import Dataset, concatenate
from etude.robots.spec import RobotSpec

Array = NDArray[np.float64]

ROUNDING = 1e-6  # s: time stamps are sums of steps
GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class DataConfig:
    """How a log becomes a data set.

    Attributes:
        inputs: "measured" differentiates the filtered measured position; "desired" takes the desired motion
            (thesis). A logged velocity is not used: its filter, and so its phase, are unknown.
        cutoff_hz: zero-phase low-pass of position and command alike, Hz; "auto" by `derivatives.auto_cutoff`,
            "none" leaves both as measured.
        rate_hz: samples kept per second at least, evenly spaced. Thesis 6.2: all 100 Hz for a dictionary to
            choose from, and 100/12 for downsampling.
        least_samples: of a log so short that fewer than these would be left, more are kept per second, up to
            all: a fast robot's motion of some seconds has as much to tell as a slow one's of a minute.
        stick_fraction: a joint slower than this part of its top speed in the log, or of its limit if that is
            less, counts as stuck; 0 masks nothing. Around a stick-slip the filter smears the motion, so the
            speed below which samples lie about the friction is far above the encoder's noise.
        trim_s: seconds cut from both ends of every stretch of log; "auto" = one period of the cutoff.
            Samples before t = 0 (lead-in) are always cut, but the filter may look at them.
    """

    inputs: Literal["measured", "desired"] = "measured"
    cutoff_hz: float | Literal["auto", "none"] = "auto"
    rate_hz: float = 8.0
    least_samples: int = 150
    stick_fraction: float = 0.05
    trim_s: float | Literal["auto"] = "auto"

    def __post_init__(self) -> None:
        if self.inputs not in ("measured", "desired"):
            raise UsageError(
                f"inputs must be 'measured' or 'desired', not '{self.inputs}'", where="data.inputs"
            )
        _check_number("cutoff_hz", self.cutoff_hz, ("auto", "none"), above_zero=True)
        _check_number("rate_hz", self.rate_hz, (), above_zero=True)
        _check_number("least_samples", self.least_samples, (), above_zero=False)
        _check_number("stick_fraction", self.stick_fraction, (), above_zero=False)
        _check_number("trim_s", self.trim_s, ("auto",), above_zero=False)


def _check_number(name: str, value: float | str, words: tuple[str, ...], *, above_zero: bool) -> None:
    if isinstance(value, str):
        good = value in words
    else:
        good = math.isfinite(value) and (value > 0 if above_zero else value >= 0)
    if not good:
        kind = "above zero" if above_zero else "zero or more"
        choices = "".join(f" or '{word}'" for word in words)
        raise UsageError(f"{name} must be a number {kind}{choices}, not {value!r}", where=f"data.{name}")


PRESETS = {
    "default": DataConfig(),
    "thesis": DataConfig(
        inputs="desired", cutoff_hz="none", rate_hz=100.0, least_samples=0, stick_fraction=0.0, trim_s=0.0
    ),
}


def preset(name: str) -> DataConfig:
    """The named configuration: "thesis" is the faithful protocol, "default" the good one."""
    if name not in PRESETS:
        raise UsageError(f"unknown data preset '{name}'", next_step=f"Valid presets: {', '.join(PRESETS)}.")
    return PRESETS[name]


def build_dataset(log: RobotLog, spec: RobotSpec, config: DataConfig, group: int = 0) -> Dataset:
    """The samples a model learns from: filtered, trimmed, thinned, with the stick mask of every output.

    Args:
        log: a cleaned log whose axes are those of `spec`, in its order; pauses split it.
        spec: gives the velocity limits, the scale of the stick mask.
        config: the protocol.
        group: number of the trajectory; it also shifts the thinning, so that repeated motions add samples.

    Raises:
        DataError: the axes differ, desired inputs are asked of a log without them, or nothing is left.
    """
    if log.names != spec.names:
        raise DataError(
            f"the log has the joints {', '.join(log.names)}, the robot {', '.join(spec.names)}",
            where=log.source,
        )
    if config.inputs == "desired" and log.q_des is None:
        raise DataError(
            "the log has no desired motion, which inputs = 'desired' needs",
            where=log.source,
            next_step="Tell it with its proposal, or use inputs = 'measured'.",
        )
    rate = median_rate(log.t)
    cutoff = filter_cutoff(log, config)
    config = replace(config, rate_hz=max(config.rate_hz, config.least_samples / duration(log)))
    parts = [
        part for piece in segments(log.t) if (part := _segment(log, piece, rate, cutoff, spec, config, group))
    ]
    if not parts:
        raise DataError(
            f"nothing is left of this log of {log.t[-1] - log.t[0]:.3g} s after trimming",
            where=log.source,
            next_step="Record a longer motion, or lower trim_s.",
        )
    return concatenate(parts)


def duration(log: RobotLog) -> float:
    """Seconds that the log's stretches last together."""
    return float(sum(np.ptp(log.t[piece]) for piece in segments(log.t)))


def filter_cutoff(log: RobotLog, config: DataConfig) -> float:
    """The cutoff in Hz with which `build_dataset` filters the log; infinite without a filter."""
    rate = median_rate(log.t)
    if config.cutoff_hz == "none":
        return math.inf
    if config.cutoff_hz != "auto":
        return float(config.cutoff_hz)
    longest = max(segments(log.t), key=lambda piece: piece.stop - piece.start)
    grid = uniform_grid(log.t[longest], rate)
    return auto_cutoff(grid, resample(log.t[longest], log.q[longest], grid))


def _segment(
    log: RobotLog, piece: slice, rate: float, cutoff: float, spec: RobotSpec, config: DataConfig, group: int
) -> Dataset | None:
    t = log.t[piece]
    trim = 1.0 / cutoff if config.trim_s == "auto" else config.trim_s
    if len(t) < 8 or t[-1] - t[0] <= 2 * trim:
        return None
    grid = uniform_grid(t, rate)
    motion = _inputs(log, piece, grid, cutoff, config)
    tau = smooth(grid, resample(t, log.tau[piece], grid), cutoff).value
    inside = (grid >= max(0.0, grid[0] + trim) - ROUNDING) & (grid <= grid[-1] - trim + ROUNDING)
    keep = np.flatnonzero(inside)[_offset(rate, config.rate_hz, group) :: _step(rate, config.rate_hz)]
    if not len(keep):
        return None
    top = np.minimum(spec.velocity, np.abs(motion.first[inside]).max(axis=0))
    stuck = np.abs(motion.first[keep]) < config.stick_fraction * top
    return Dataset(
        grid[keep],
        motion.value[keep],
        motion.first[keep],
        motion.second[keep],
        tau[keep],
        stuck,
        np.full(len(keep), group, dtype=np.int64),
    )


def _inputs(log: RobotLog, piece: slice, grid: Array, cutoff: float, config: DataConfig) -> Smoothed:
    t = log.t[piece]
    if config.inputs == "measured":
        return smooth(grid, resample(t, log.q[piece], grid), cutoff)
    assert log.q_des is not None  # checked where the log entered
    if log.qd_des is None or log.qdd_des is None:
        return smooth(grid, resample(t, log.q_des[piece], grid), cutoff)
    desired = [resample(t, values[piece], grid) for values in (log.q_des, log.qd_des, log.qdd_des)]
    return Smoothed(grid, *desired)


def _step(rate: float, rate_hz: float) -> int:
    """Every how many samples one is kept, so that at least rate_hz remain per second."""
    return max(1, int(rate / rate_hz + 1e-3))


def _offset(rate: float, rate_hz: float, group: int) -> int:
    """First kept sample: multiples of the golden ratio visit the step evenly, whatever the number of logs."""
    return int(_step(rate, rate_hz) * ((group * GOLDEN) % 1.0))
