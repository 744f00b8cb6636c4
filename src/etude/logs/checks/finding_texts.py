"""How findings name joints and answers, and what a repair of theirs needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.types import Finding, Mask


@dataclass(frozen=True)
class Mendable(Finding):
    """A finding that a repair can act upon; by: what the repair needs, see `repairs`."""

    by: tuple[float, ...] = ()


def named(parts: Sequence[str], which: Mask) -> str:
    """The names of those joints: "elbow", "hip and knee", "a, b and c"; "" of none."""
    names = [parts[j] for j in np.flatnonzero(which).tolist()]
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def accepted(check: str) -> str:
    """The answer that takes the log as it is."""
    return f"--accept {check} takes it as it is"


def both(check: str, what: str) -> str:
    """The two answers to a question that Étude can act on; `what` is the repair in words."""
    return f"Tell it with --repair {check} to {what}; {accepted(check)}."
