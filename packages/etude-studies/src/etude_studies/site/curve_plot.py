"""Curves over the number of trajectories, with bands, printed numbers, and other lines in grey."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from etude.report import Axis, Html, Mark, Scale, panel, polyline, text
from etude.types import Array
from etude_studies.site.dot_plot import FAR, WIDE, interval_text
from etude_studies.site.marks import Style, label, printed_sign, sign
from etude_studies.site.numbers import Summary

SIZE = (400, 300)
APART = 12.0
"""Between names of lines, px."""
ALIKE = 1e-6


@dataclass(frozen=True)
class Curve:
    """One series: means with a band of their intervals.

    Attributes:
        results: summaries by count. printed: the thesis's numbers by count.
    """

    name: str
    results: Mapping[int, Summary]
    look: Style
    printed: Mapping[int, float]
    label: str = ""
    style: str = ""

    def extent(self) -> tuple[Array, Array]:
        means = [result.mean for result in self.results.values()]
        bounds = [v for result in self.results.values() for v in (result.low, result.high)]
        values = [*means, *bounds, *self.printed.values()]
        at = [*self.results, *self.results, *self.results, *self.printed]
        return np.array(at, dtype=float), np.array(values)

    def draw(self, x: Scale, y: Scale) -> str:
        at = np.array(sorted(self.results), dtype=float)
        results = [self.results[int(k)] for k in at]
        low, mean, high = (np.array([getattr(s, n) for s in results]) for n in ("low", "mean", "high"))
        around = polyline(np.concatenate([x(at), x(at[::-1])]), np.concatenate([y(low), y(high[::-1])]))
        band = f'<path class="ci {self.look.colour}" d="{around}Z"/>' if len(at) > 1 else ""
        line = f'<path class="line mark {self.look.colour} {self.look.dash}" d="{polyline(x(at), y(mean))}"/>'
        return band + (line if len(at) > 1 else "") + self._signs(x, y) + self._printed(x, y)

    def _signs(self, x: Scale, y: Scale) -> str:
        places = ((float(x(k)), float(y(result.mean)), k, result) for k, result in self.results.items())
        return "".join(
            sign(self.look, px, py, f"{self.name} after {k}: {interval_text(result)}, {result.n} seeds", 3.8)
            for px, py, k, result in places
        )

    def _printed(self, x: Scale, y: Scale) -> str:
        tip, colour = f"{self.name}, the thesis: ", self.look.colour
        places = ((float(x(k)), float(y(value)), value) for k, value in self.printed.items())
        return "".join(printed_sign(px, py, f"{tip}{value:.4g}", colour) for px, py, value in places)

    def swatch(self, x: float, y: float) -> str:  # noqa: ARG002
        return ""  # named under the drawing


@dataclass(frozen=True)
class Others:
    """Lines to compare with, a letter at the right of each; those out of sight have an arrow at the edge."""

    lines: Sequence[tuple[str, Mapping[int, Summary]]]
    label: str = ""
    style: str = "base"

    def extent(self) -> tuple[Array, Array]:
        return np.empty(0), np.empty(0)

    def draw(self, x: Scale, y: Scale) -> str:
        parts, names = [], []
        for place, (name, results) in enumerate(self.lines):
            at = np.array(sorted(results), dtype=float)
            mean = np.array([results[int(k)].mean for k in at])
            ends = np.array([x.start, x.end]) if len(at) == 1 else x(at)
            py = y(np.repeat(mean, 2) if len(at) == 1 else mean)
            inside = np.where((py >= y.end - 0.5) & (py <= y.start + 0.5), py, np.nan)
            tip = f"<title>{text(name)}: {mean[-1]:.3g}</title>"
            parts.append(f'<path class="line base mark" d="{polyline(ends, inside)}">{tip}</path>')
            names.append((float(py[-1]), letter(place)))
        return "".join(parts) + _names(names, x, y)

    def swatch(self, x: float, y: float) -> str:  # noqa: ARG002
        return ""


def curve_plot(
    title: str,
    curves: Sequence[Curve],
    others: Sequence[tuple[str, Mapping[int, Summary]]],
    *,
    x: str,
    y: str,
    log_x: bool = False,
) -> Html:
    """The drawing. Lines far above everything else do not stretch the axis."""
    values = np.concatenate([curve.extent()[1] for curve in curves])
    usable = values[np.isfinite(values)]
    low, high = float(usable.min()), float(usable.max())
    log = low > 0.0 and high > WIDE * low
    near = [result.mean for _, results in others for result in results.values() if result.mean <= FAR * high]
    limits = _limits([low, high, *near], log=log)
    marks: list[Mark] = [Others(others)]
    marks.extend(curves)
    axis = Axis(x, log=log_x, whole=not log_x)
    return panel(title, axis, Axis(y, log=log, limits=limits), marks, size=SIZE)


def _limits(values: Sequence[float], *, log: bool) -> tuple[float, float]:
    low, high = min(values), max(values)
    if log:
        return low / 1.25, high * 1.25
    air = 0.06 * (high - min(low, 0.0)) or 1.0
    return (0.0 if low >= 0.0 else low - air), high + air


def letter(place: int) -> str:
    """By which a line to compare with is named on the drawing and under it."""
    return "abcdefghijklmnopqrstuvwxyz"[place % 26]


def _names(names: Sequence[tuple[float, str]], x: Scale, y: Scale) -> str:
    """At the right, moved apart where they would overlap, and held beside the panel."""
    placed, below = [], math.inf
    for py, name in sorted(names, reverse=True):
        arrow = "▾" if py > y.start + ALIKE else "▴" if py < y.end - ALIKE else ""
        below = min(min(max(py, y.end), y.start) + 4.0, below - APART)
        placed.append((below, name + arrow))
    lift = max(0.0, y.end + 4.0 - below)
    return "".join(label(x.end + 3.0, py + lift, name, "rule") for py, name in placed)
