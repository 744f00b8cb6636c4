"""How far a robot stays from itself and from what stands around it: limits that have no upper end."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from etude.report.markup import Html, number, paragraph, table
from etude.report.record import Facts
from etude.report.scales import Axis
from etude.report.sections.learning import joint_style
from etude.report.svg import Level, Line, Mark, panel
from etude.types import Array, Proof

NEAREST = 6
"""Distances that are shown one by one; an arm has dozens."""
FARTHEST = 10.0
"""What is drawn of a distance, in parts of what is to be kept."""


def use_of_distance(kept: float, proved: float) -> float:
    """The part of a distance that is to be kept anyway; 1 where it is touched."""
    return kept / proved if proved > 0.0 else math.inf


def distances(rows: Sequence[Facts]) -> list[Html]:
    """The nearest ones with where and when, from a certificate's rows; nothing if no row is a distance."""
    own = [row for row in rows if row["upper"] is None]
    own.sort(key=lambda row: use_of_distance(row["lower"], row["proved_lower"]), reverse=True)
    if not own:
        return []
    header = ["", "proved distance (m)", "to keep (m)", "nearest"]
    body = [
        [row["axis"], number(row["proved_lower"], 4), number(row["lower"], 3), row["where"] or "far"]
        for row in own[:NEAREST]
    ]
    rest = own[NEAREST:]
    least = min((row["proved_lower"] for row in rest), default=0.0)
    more = f"{len(rest)} more distances, all at least {number(least, 3)} m."
    return [table(header, body), *([paragraph(more, class_="soft")] if rest else [])]


def distance_panel(rows: Sequence[Proof], measured: Array, t: Array) -> Html:
    """Distances (T, n) over time as multiples of what is to be kept, the nearest of them."""
    nearest = np.argsort([row.proved_lower / row.lower for row in rows])[:NEAREST]
    marks: list[Mark] = [
        Line(t, np.minimum(measured[:, i] / rows[i].lower, FARTHEST), rows[i].axis, joint_style(k))
        for k, i in enumerate(nearest)
    ]
    axes = Axis("time (s)", limits=(0.0, float(t[-1]))), Axis("multiple of limit (1)", limits=(0.0, FARTHEST))
    return panel("Clearance / limit", *axes, [*marks, Level(1.0, style="limit")], size=(380, 300))
