"""One line for every row: its mean with an interval, the printed number above it, other lines across all."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from etude.report import Axis, Html, Scale, fitted_scale, number, tick_text
from etude_studies.site.marks import WIDTH, Style, drawing, label, printed_sign, sign, whisker
from etude_studies.site.numbers import Summary

LEFT, RIGHT = 14.0, WIDTH - 14.0
ROW = 44.0
DENSE, MARGIN = 17.0, 108.0
"""Height of a row, and room for names at its left, where there are many."""
LINE = 15.0
"""Height of one row of names of lines, px."""
CHARACTER = 7.0
"""Width to keep for a character of the lines' 12 px type."""
FAR = 1.6
"""A line beyond this multiple of everything else is named at the edge, so that rows keep their room."""
WIDE = 15.0
"""Ratio of largest to smallest from which the axis is logarithmic."""


@dataclass(frozen=True)
class Dot:
    """One row.

    Attributes:
        name: above it. result, printed: our number and the thesis's, as far as there are any.
        single: the interval of a single run. asked: seeds that have the figure, finite or not.
    """

    name: str
    result: Summary | None
    printed: float | None
    style: Style
    single: tuple[float, float] | None = None
    asked: int = 0

    @property
    def value_text(self) -> str:
        """The number with its interval, and of how many seeds where not all have one."""
        if self.result is None:
            return f"none of {self.asked} seeds" if self.asked else ""
        some = f", {self.result.n} of {self.asked}" if self.result.n < self.asked else ""
        return interval_text(self.result) + some


@dataclass(frozen=True)
class Rule:
    """A labelled line across the rows."""

    name: str
    value: float


def dot_plot(
    title: str,
    dots: Sequence[Dot],
    rules: Sequence[Rule] = (),
    *,
    axis: str,
    log: bool | None = None,
    band: tuple[float, float] | None = None,
    centre: float | None = None,
    dense: bool = False,
) -> Html:
    """The drawing; `log` by the numbers themselves if None.

    Args:
        rules: lines to compare with; those far away are named at the edge.
        band: values that count as equal, shaded. centre: where "no difference" is.
        dense: many rows, with names at the left and numbers only under the pointer.
    """
    values = list(_values(dots)) + list(band or ()) + [v for v in (centre,) if v is not None]
    left, row = (MARGIN, DENSE) if dense else (LEFT, ROW)
    scale = _scale(values, rules, axis, log, keep=centre is not None, left=left)
    near = [rule for rule in rules if scale.low <= rule.value <= scale.high]
    far = [rule for rule in rules if rule not in near]
    levels, rows = _levels(near, scale)
    top = 8.0 + LINE * (rows + len(far))
    bottom = top + row * len(dots)
    drawn = [ground(scale, top, bottom, axis, band, centre), *_far(far, rows, scale)]
    drawn += [_rule(rule, level, scale, bottom) for rule, level in zip(near, levels, strict=True)]
    drawn += [_rule_name(rule, level, scale) for rule, level in zip(near, levels, strict=True)]
    draw = _thin if dense else _row
    drawn += [draw(dot, top + row * place, scale) for place, dot in enumerate(dots)]
    return drawing(title, bottom + 44.0, "".join(drawn))


def _values(dots: Iterable[Dot]) -> Iterable[float]:
    for dot in dots:
        interval = (dot.result.mean, dot.result.low, dot.result.high) if dot.result else ()
        yield from (v for v in (*interval, dot.printed, *(dot.single or ())) if v is not None)


def _scale(
    values: list[float], rules: Sequence[Rule], axis: str, log: bool | None, *, keep: bool, left: float
) -> Scale:
    finite = [v for v in values if math.isfinite(v)] or [1.0]
    low, high = min(finite), max(finite)
    wide = low > 0.0 and high > WIDE * low if log is None else log
    fits = [r.value for r in rules if r.value <= FAR * high and (not wide or r.value >= low / FAR)]
    floor = None if wide or keep or low < 0.0 else 0.0
    return fitted_scale(Axis(axis, log=wide, floor=floor), np.array([*finite, *fits]), left, RIGHT)


def ground(
    scale: Scale, top: float, bottom: float, axis: str, band: tuple[float, float] | None, centre: float | None
) -> str:
    """Grid, axis and its name below a drawing; `band` counts as equal, `centre` as no difference."""
    parts = []
    if band is not None:
        x0, x1 = (float(v) for v in scale(list(band)))
        size = f'width="{x1 - x0:.1f}" height="{bottom - top:.1f}"'
        parts.append(f'<rect class="equal" x="{x0:.1f}" y="{top:.1f}" {size}/>')
    for value in scale.ticks():
        px = float(scale(value))
        parts.append(f'<path class="grid-line" d="M{px:.1f},{top:.1f}V{bottom + 4:.1f}"/>')
        parts.append(label(px, bottom + 18, tick_text(value), "tick", "middle"))
    if centre is not None:
        parts.append(f'<path class="axis-line" d="M{float(scale(centre)):.1f},{top:.1f}V{bottom:.1f}"/>')
    parts.append(f'<path class="axis-line" d="M{scale.start:.1f},{bottom:.1f}H{scale.end:.1f}"/>')
    return "".join(parts) + label((scale.start + scale.end) / 2, bottom + 36, axis, "axis", "middle")


def _levels(rules: Sequence[Rule], scale: Scale) -> tuple[list[int], int]:
    """The row of each name above the drawing, so that none overlaps another; and how many rows there are."""
    ends: list[float] = []
    placed = {}
    for rule in sorted(rules, key=lambda item: item.value):
        start, end = _span(rule, scale)
        level = next((i for i, taken in enumerate(ends) if taken + 6.0 < start), len(ends))
        ends[level : level + 1] = [end]
        placed[rule] = level
    return [placed[rule] for rule in rules], len(ends)


def _span(rule: Rule, scale: Scale) -> tuple[float, float]:
    width = CHARACTER * len(_caption(rule))
    middle = float(scale(rule.value))
    start = min(max(middle - width / 2, 2.0), WIDTH - 2.0 - width)
    return start, start + width


def _caption(rule: Rule) -> str:
    return f"{rule.name} {number(rule.value)}"


def _rule(rule: Rule, level: int, scale: Scale, bottom: float) -> str:
    x = float(scale(rule.value))
    return f'<path class="line base mark" d="M{x:.1f},{16.0 + LINE * level:.1f}V{bottom:.1f}"/>'


def _rule_name(rule: Rule, level: int, scale: Scale) -> str:
    start, end = _span(rule, scale)
    return label((start + end) / 2, 12.0 + LINE * level, _caption(rule), "rule halo", "middle")


def _far(rules: Sequence[Rule], rows: int, scale: Scale) -> list[str]:
    """Names of lines outside the drawing, with an arrow to where they are."""
    out = []
    for place, rule in enumerate(rules):
        y, beyond = 12.0 + LINE * (rows + place), rule.value > scale.high
        caption = f"{_caption(rule)} ▸" if beyond else f"◂ {_caption(rule)}"
        out.append(label(RIGHT if beyond else LEFT, y, caption, "rule", "end" if beyond else "start"))
    return out


def _row(dot: Dot, top: float, scale: Scale) -> str:
    """Name and numbers above the mark."""
    value_text = dot.value_text
    room = int((RIGHT - LEFT) / CHARACTER) - len(value_text) - 1
    name = dot.name if len(dot.name) <= room else f"{dot.name[: room - 1]}…"
    number_ = label(RIGHT, top + 15, value_text, "value halo", "end") if value_text else ""
    return label(LEFT, top + 15, name, "name halo") + _marks(dot, top + 32.0, scale) + number_


def _thin(dot: Dot, top: float, scale: Scale) -> str:
    """The name at the left of the mark."""
    y = top + DENSE / 2
    return label(2.0, y + 4.0, dot.name, "tick") + _marks(dot, y, scale)


def _marks(dot: Dot, y: float, scale: Scale) -> str:
    parts, result = [], dot.result
    if dot.single is not None:
        x0, x1 = (float(v) for v in scale(list(dot.single)))
        parts.append(f'<path class="single mark" d="M{x0:.1f},{y:.1f}H{x1:.1f}"/>')
    if result is not None:
        x, x0, x1 = (float(v) for v in scale([result.mean, result.low, result.high]))
        tip = f"{dot.name}: {interval_text(result)}, {result.n} seeds"
        parts += [whisker(dot.style, x0, x1, y), sign(dot.style, x, y, tip)]
    if dot.printed is not None:
        parts.append(printed_sign(float(scale(dot.printed)), y, f"the thesis: {number(dot.printed, 4)}"))
    return "".join(parts)


def interval_text(result: Summary) -> str:
    """ "1.02 [0.95, 1.10]"; the number alone for a single seed."""
    if result.n < 2:
        return number(result.mean)
    return f"{number(result.mean)} [{number(result.low)}, {number(result.high)}]"
