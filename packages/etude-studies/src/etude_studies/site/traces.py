"""Motions and commands over time of one seed, kept by runs whose names end in "t".

Of run "A1" they are in "A1t": k counts instants, the test says after how many trajectories ("after 6"), part
"mean" has the time "t", s, and each joint or command has the measures of `SHOWN`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from etude.report import Axis, Html, Line, Mark, Scale, panel, polyline, thinned
from etude.types import Array
from etude_studies.site.marks import Style
from etude_studies.site.numbers import Numbers
from etude_studies.thesis.ledger import Entry, Row

SIZE = (400, 250)
PATH = (400, 398)
"""Whose axes are as long as each other."""


@dataclass(frozen=True)
class Shown:
    """A measure on a drawing over time."""

    name: str
    style: Style


SHOWN: Mapping[str, Shown] = {
    "q_des": Shown("desired angle", Style("c8", "circle", "dash")),
    "q": Shown("actual angle", Style("c1", "circle", "")),
    "desired": Shown("desired", Style("c8", "circle", "dash")),
    "flown": Shown("flown", Style("c1", "circle", "")),
    "u": Shown("applied command", Style("c8", "circle", "thin")),
    "u_ff": Shown("the model's command", Style("c2", "circle", "")),
    "actual": Shown("actual command", Style("c8", "circle", "thin")),
    "mean": Shown("predicted mean", Style("c2", "circle", "")),
    "deviation": Shown("1-sigma bounds", Style("c2", "band", "")),
}
OF_ENTRY: Mapping[str, tuple[str, ...]] = {
    "angle": ("q_des", "q"),
    "command": ("u", "u_ff", "actual", "mean", "deviation"),
    "position": ("desired", "flown"),
}
"""By an entry's measure, what is drawn where it is there."""

Traces = Mapping[str, tuple[Array, Array]]
"""Time (n,) s and value (n,) by measure."""


@dataclass(frozen=True)
class Bounds:
    """The region between two curves over x."""

    x: Array
    low: Array
    high: Array
    style: str
    label: str = ""

    def extent(self) -> tuple[Array, Array]:
        return np.concatenate([self.x, self.x]), np.concatenate([self.low, self.high])

    def draw(self, x: Scale, y: Scale) -> str:
        px = np.concatenate([x(self.x), x(self.x[::-1])])
        py = np.concatenate([y(self.low), y(self.high[::-1])])
        return f'<path class="ci mark {self.style}" d="{polyline(px, py)}Z"/>'

    def swatch(self, x: float, y: float) -> str:  # noqa: ARG002
        return ""  # named under the drawing


def traces(numbers: Numbers, entry: Entry, row: Row, part: str, seed: int = 0) -> Traces:
    """Of a row and a joint or command; empty where none are kept."""
    run, test = f"{row.run}t", f"after {(row.at or entry.at)[-1]}"
    times = numbers.by_k(run, "t", test, "mean")
    recorded = {}
    for measure in OF_ENTRY.get(entry.measure, ()):
        by_k = numbers.by_k(run, measure, test, part)
        points = [(times.get(k, {}).get(seed, math.nan), by.get(seed, math.nan)) for k, by in by_k.items()]
        if points:
            t, value = np.array(points).T
            recorded[measure] = t, value
    return recorded


def trace_plot(title: str, recorded: Traces, y: str) -> Html:
    """The drawing of one joint or command."""
    marks: list[Mark] = []
    if "deviation" in recorded and "mean" in recorded:
        (t, mean), (_, spread) = recorded["mean"], recorded["deviation"]
        marks.append(Bounds(t, mean - spread, mean + spread, "c2 bounds"))
    for measure, (t, value) in recorded.items():
        if measure != "deviation":
            style = SHOWN[measure].style
            marks.append(Line(*thinned(t, value), style=f"mark {style.colour} {style.dash}"))
    return panel(title, Axis("time (s)"), Axis(y), marks, size=SIZE)


def joined_plot(title: str, rows: Sequence[Traces], styles: Sequence[Style], y: str) -> Html:
    """One joint of several rows: the desired angle once, the actual one of each row in its style."""
    desired = SHOWN["q_des"].style
    marks = [Line(*thinned(*rows[0]["q_des"]), style=f"mark {desired.colour} {desired.dash}")]
    for recorded, style in zip(rows, styles, strict=True):
        marks.append(Line(*thinned(*recorded["q"]), style=f"mark {style.colour} {style.dash}"))
    return panel(title, Axis("time (s)"), Axis(y), marks, size=SIZE)


def path_plot(title: str, x: Traces, y: Traces, unit: str) -> Html:
    """A flight seen from above: the desired and the flown path, a metre as long on both axes."""
    marks = []
    for measure in x:
        style = SHOWN[measure].style
        marks.append(Line(x[measure][1], y[measure][1], style=f"mark {style.colour} {style.dash}"))
    spans = [np.concatenate([line[1] for line in axis.values()]) for axis in (x, y)]
    half = max(float(np.ptp(span)) for span in spans) * 0.55 or 1.0
    middle = [float(span.min() + span.max()) / 2 for span in spans]
    across, along = ((m - half, m + half) for m in middle)
    return panel(
        title, Axis(f"x ({unit})", limits=across), Axis(f"y ({unit})", limits=along), marks, size=PATH
    )


def names(recorded: Traces) -> list[tuple[str, Style]]:
    """For the legend."""
    return [(SHOWN[measure].name, SHOWN[measure].style) for measure in recorded]


def kernel_plot(title: str, numbers: Numbers, model: str) -> Html | None:
    """Kernels of spectral points with bands of half and 95 % of the draws; None: there are none."""
    lags = _of_places(numbers, "K1", "lag")
    exact, drawn = _of_places(numbers, "K1:exact", "kernel"), _of_places(numbers, f"K1:{model}", "kernel")
    if not len(lags) or not len(exact) or not len(drawn):
        return None
    x = lags[:, 0]
    marks: list[Mark] = [_between(x, drawn, share) for share in (0.95, 0.5)]
    marks += [
        Line(x, exact[:, 0], style="mark c8 dash"),
        Line(x, drawn[:, 0], style="mark c1"),
    ]
    return panel(title, Axis("x1 − x2 (length scales)"), Axis("covariance"), marks, size=SIZE)


def kernel_names() -> Sequence[tuple[str, Style]]:
    """For the legend of `kernel_plot`."""
    return [
        ("squared exponential", Style("c8", "circle", "dash")),
        ("one draw; bands: half and 95 % of the draws", Style("c1", "circle", "")),
    ]


def _of_places(numbers: Numbers, source: str, measure: str) -> Array:
    """(places, seeds)."""
    by_place = numbers.by_k(source, measure, "", "D1")
    seeds = sorted({seed for by in by_place.values() for seed in by})
    return np.array([[by.get(seed, math.nan) for seed in seeds] for by in by_place.values()], dtype=float)


def _between(x: Array, drawn: Array, share: float) -> Bounds:
    low, high = np.nanquantile(drawn, [0.5 - share / 2, 0.5 + share / 2], axis=1)
    return Bounds(x, low, high, "c1")
