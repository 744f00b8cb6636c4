"""Texts of findings: names of joints and answers, and the needs of a repair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.types import Finding, Log, Mask


@dataclass(frozen=True)
class Doubt(Finding):
    """A question: its answer applies to every log with the same finding.

    Attributes:
        by: the finding in numbers. For a `Mendable`, the data of the repair, see `plausibility`.
    """

    by: tuple[float, ...] = ()


@dataclass(frozen=True)
class Mendable(Doubt):
    """A question that a repair can answer.

    Attributes:
        free: the repair loses nothing and the data decide, so that it needs no answer.
    """

    free: bool = False


class OfRecorder(Finding):
    """A finding about who wrote the log; Étude's own recordings have none."""


class Excludable(Finding):
    """A finding whose spans are no training data; a cleaned log has them removed."""

    def cut(self, log: Log) -> Log:
        """The log less the finding's spans; what is left has pauses there."""
        return without_spans(log, self).repaired(f"{self.sentence} That was cut.")


def without_spans(log: Log, finding: Finding) -> Log:
    """The log less the rows in the finding's spans."""
    outside = np.ones(len(log), dtype=np.bool_)
    for start, end in finding.spans:
        outside &= (log.t < start) | (log.t >= end)
    return log.take(outside)


def named(parts: Sequence[str], which: Mask) -> str:
    """The names of those joints: "elbow", "hip and knee", "a, b and c"; "" of none."""
    names = [parts[j] for j in np.flatnonzero(which).tolist()]
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def accepted(check: str) -> str:
    """Text of the answer that accepts the log unchanged."""
    return f"--accept {check} uses the log without a repair"


def both(check: str, what: str) -> str:
    """The two answers to a question that Étude can act on; `what` is the repair in words."""
    return f"Ingest it with --repair {check} to {what}; {accepted(check)}."
