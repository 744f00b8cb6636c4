"""Configuration table [data] of an arm's campaign: preprocessing of its logs into samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from etude.errors import UsageError

_COUNTS = ("least_samples", "stick_fraction", "reversal", "plenty", "friction_fraction", "presliding")


@dataclass(frozen=True)
class ArmData:
    """Preprocessing of logs into samples, and the inputs: the [data] table of a campaign.

    Attributes:
        inputs: "measured" differentiates the filtered measured position; "desired" takes the desired motion
            (thesis). A logged velocity is not used, because its filter and phase are unknown.
        cutoff_hz: zero-phase low-pass of position and command, Hz. "auto" is `smoothing.auto_cutoff`, for
            forces up to 5 Hz as noise allows, or 5 or 10 Hz if that removes visible parts of the commands;
            "none" leaves both as measured.
        rate_hz: least number of samples per second, evenly spaced. Thesis 6.2: all 100 Hz for a dictionary,
            and 100/12 for downsampling.
        least_samples: a short log keeps more samples per second to reach this number. A fast motion of some
            seconds is as informative as a slow one of a minute. With fewer samples, the error depends on
            which instants are kept. Training takes no nearer ones.
        stick_fraction: a joint below this fraction of its top speed in the log, or of a smaller limit, is at
            rest; 0 masks nothing. Around a stick-slip the filter smears the motion. So the speed below which
            samples misrepresent friction is far above the encoder's noise.
        presliding: presliding distance, rad (a tenth of it in m for a slide). Every sample then has a
            friction state. 0: no state, and only `stick_fraction` decides when a joint is at rest, without
            the encoder's resolution.
        reversal: periods of the cutoff around a fast reversal of a joint whose samples are left out, because
            the filter smears the friction step over them; 0 leaves none out. A reversal of more than a period
            is not fast: the joint rests, and `stick_fraction` masks it.
        plenty: samples that a joint must keep for `reversal`; with fewer, all of them are learned.
        trim_s: trimmed from both ends of every part of a log, s; "auto" = one period of the cutoff. Samples
            before t = 0 (lead-in) are always trimmed, but the filter uses them.
        friction_fraction: v0 of the friction inputs as a fraction of the velocity limit, of 3 rad/s at most;
            0 for no such inputs.
        offset: start of the thinning. "spread": different in each log, so that repeated motions add samples;
            "first": at its first sample (thesis 6.2).
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
        """Whether models use the plan."""
        return self.inputs == "desired"


def _check_number(name: str, value: float | str, keywords: tuple[str, ...], *, above_zero: bool) -> None:
    if isinstance(value, str):
        good = value in keywords
    else:
        good = math.isfinite(value) and (value > 0 if above_zero else value >= 0)
    if not good:
        kind = "above zero" if above_zero else "zero or more"
        choices = "".join(f" or '{word}'" for word in keywords)
        raise UsageError(f"{name} must be a number {kind}{choices}, not {value!r}", where=f"data.{name}")
