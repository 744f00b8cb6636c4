"""The [data] table of an arm's campaign: preprocessing of its logs into samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from etude.errors import UsageError

_COUNTS = ("least_samples", "stick_fraction", "reversal", "plenty", "friction_fraction", "presliding")


@dataclass(frozen=True)
class ArmData:
    """How logs become samples, and what their inputs are; the [data] table of a campaign.

    Attributes:
        inputs: "measured" differentiates the filtered measured position; "desired" takes the desired motion
            (thesis). A logged velocity is not used: its filter, and so its phase, are unknown.
        cutoff_hz: zero-phase low-pass of position and command alike, Hz; "auto" by `logs.steps.auto_cutoff`,
            or 5 or 10 Hz where that takes away what the log's commands show; "none" leaves both as measured.
        rate_hz: samples kept per second at least, evenly spaced. Thesis 6.2: all 100 Hz for a dictionary to
            choose from, and 100/12 for downsampling.
        least_samples: of a log so short that fewer than these would be left, more are kept per second, up to
            all: a fast robot's motion of some seconds has as much to tell as a slow one's of a minute. With
            fewer it is chance which instants were kept, and the error is too. Training takes no nearer ones.
        stick_fraction: a joint slower than this part of its top speed in the log, or of its limit if that is
            less, counts as stuck; 0 masks nothing. Around a stick-slip the filter smears the motion, so the
            speed below which samples lie about the friction is far above the encoder's noise.
        presliding: way over which a joint's friction turns round, rad (a tenth of it in m for a slide); what
            friction remembers of the motion before is then a state of every sample. 0: nothing is remembered,
            and only `stick_fraction` says when a joint stands, not the encoder's resolution too.
        reversal: periods of the cutoff before and after a fast reversal of a joint in which its samples are
            left out, since the filter smears the step of friction over them; 0 leaves none out. One that
            takes longer than a period is not fast: the joint stands, and `stick_fraction` masks it.
        plenty: samples that a joint has to have left for that; with fewer all of them teach.
        trim_s: seconds cut from both ends of every stretch of log; "auto" = one period of the cutoff.
            Samples before t = 0 (lead-in) are always cut, but the filter may look at them.
        friction_fraction: v0 of the friction inputs as a part of the velocity limit, of 3 rad/s at most; 0
            for no such inputs.
        offset: where the thinning of a log begins: "spread" elsewhere in each, so that repeated motions add
            samples; "first" at its first sample (thesis 6.2).
    """

    inputs: Literal["measured", "desired"] = "measured"
    cutoff_hz: float | Literal["auto", "none"] = "auto"
    rate_hz: float = 8.0
    least_samples: int = 300
    stick_fraction: float = 0.05
    reversal: float = 1.0
    plenty: int = 600
    trim_s: float | Literal["auto"] = "auto"
    friction_fraction: float = 0.02
    presliding: float = 0.01
    offset: Literal["spread", "first"] = "spread"

    def __post_init__(self) -> None:
        if self.inputs not in ("measured", "desired"):
            raise UsageError(
                f"inputs must be 'measured' or 'desired', not '{self.inputs}'", where="data.inputs"
            )
        if self.offset not in ("spread", "first"):
            raise UsageError(f"offset must be 'spread' or 'first', not '{self.offset}'", where="data.offset")
        _check_number("cutoff_hz", self.cutoff_hz, ("auto", "none"), above_zero=True)
        _check_number("rate_hz", self.rate_hz, (), above_zero=True)
        _check_number("trim_s", self.trim_s, ("auto",), above_zero=False)
        for name in _COUNTS:
            _check_number(name, getattr(self, name), (), above_zero=False)

    @property
    def desired(self) -> bool:
        """Whether models look at the plan."""
        return self.inputs == "desired"


def _check_number(name: str, value: float | str, words: tuple[str, ...], *, above_zero: bool) -> None:
    if isinstance(value, str):
        good = value in words
    else:
        good = math.isfinite(value) and (value > 0 if above_zero else value >= 0)
    if not good:
        kind = "above zero" if above_zero else "zero or more"
        choices = "".join(f" or '{word}'" for word in words)
        raise UsageError(f"{name} must be a number {kind}{choices}, not {value!r}", where=f"data.{name}")
