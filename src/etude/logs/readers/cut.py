"""Logs that lack their end: what a reader says of one, and how much of it is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.types import Array, Finding, Log

LEAP = 1e3  # times the usual step: no pause of a recorder, a stamp that is garbage
LONGEST = 1e7  # s: no log lasts longer
WAS_CUT = "was cut"
"""In the sentence of a reader which says that the end of a file is missing."""


def cut_sentences(log: Log) -> tuple[str, ...]:
    """Those that say that something is missing."""
    return tuple(sentence for sentence in log.repairs if WAS_CUT in sentence)


def with_rest_told(log: Log) -> Log:
    """The log; of one that was cut its sentence also says how many seconds are left.

    Args:
        log: as it was read; times in s, rows as recorded.
    """
    cut, seconds = cut_sentences(log), _recorded(log.t)
    if not cut or seconds == 0.0:
        return log
    left = f"{cut[0]} {seconds:.3g} s of it are left."
    if seconds > LONGEST:
        left = f"{cut[0]} Its times do not tell how much is left."
    return replace(log, repairs=tuple(left if one == cut[0] else one for one in log.repairs))


def _recorded(t: Array) -> float:
    """Seconds that times as recorded advance by steps that a clock may take; 0 of a single row."""
    with np.errstate(all="ignore"):
        steps = np.diff(t[np.isfinite(t)])
    steps = steps[steps > 0.0]
    return float(steps[steps <= LEAP * np.median(steps)].sum()) if len(steps) else 0.0


def end_findings(log: Log) -> tuple[Finding, ...]:
    """What is to be said of the end of a recording; nothing of one that nobody knows to be cut."""
    cut = cut_sentences(log)
    step = "Copy or record it again, if the rest is needed; what is left teaches as it is."
    return (Finding("end", "yellow", " ".join(cut), step),) if cut else ()
