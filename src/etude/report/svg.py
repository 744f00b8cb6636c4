"""SVG marks (lines, points, bands, images) on one panel of axes.

A report is read on a phone, printed, sent by mail and opened offline. A static drawing with the colours of
the page's style sheet serves all four, at a hundredth of the size of an embedded plotting library.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from etude.report.markup import Html, number, text
from etude.report.scales import Axis, Scale, fitted_scale, tick_text
from etude.types import Array

CHARACTER = 7.8
"""Width in px to keep for a character of the panels' 13 px type, to place labels without a browser."""

BOLD_CHARACTER = 8.6
"""The same for the bold names at the ends of lines."""


class Mark(Protocol):
    """A mark on a panel. `style` is a class of the style sheet; an empty `label` has no legend."""

    @property
    def label(self) -> str: ...

    @property
    def style(self) -> str: ...

    def extent(self) -> tuple[Array, Array]:
        """x and y values the axes have to contain."""
        ...

    def draw(self, x: Scale, y: Scale) -> str: ...

    def swatch(self, x: float, y: float) -> str:
        """The mark's sign in the legend, 22 px wide from (x, y)."""
        ...


@dataclass(frozen=True)
class Line:
    """A polyline through (x, y); NaN breaks it. `markers` adds a dot with a tooltip at each point."""

    x: Array
    y: Array
    label: str = ""
    style: str = "c1"
    markers: bool = False

    def extent(self) -> tuple[Array, Array]:
        return self.x, self.y

    def draw(self, x: Scale, y: Scale) -> str:
        path = f'<path class="line {self.style}" d="{polyline(x(self.x), _clipped(y, self.y))}"/>'
        dots = Points(self.x, self.y, self.label, self.style, radius=4.5).draw(x, y) if self.markers else ""
        return path + dots

    def swatch(self, x: float, y: float) -> str:
        return f'<path class="line {self.style}" d="M{x:.1f},{y:.1f}h22"/>'


@dataclass(frozen=True)
class Points:
    """Dots at (x, y)."""

    x: Array
    y: Array
    label: str = ""
    style: str = "c1"
    radius: float = 3.0

    def extent(self) -> tuple[Array, Array]:
        return self.x, self.y

    def draw(self, x: Scale, y: Scale) -> str:
        values = zip(_clipped(x, self.x), _clipped(y, self.y), self.x, self.y, strict=True)
        return "".join(self._dot(*value) for value in values if np.isfinite(value).all())

    def _dot(self, px: float, py: float, x: float, y: float) -> str:
        tip = f"<title>{text(self.label)}: {number(y)} at {number(x)}</title>" if self.label else ""
        circle = f'<circle class="dot {self.style}" cx="{px:.1f}" cy="{py:.1f}" r="{self.radius:g}"'
        return f"{circle}>{tip}</circle>" if tip else circle + "/>"

    def swatch(self, x: float, y: float) -> str:
        return f'<circle class="dot {self.style}" cx="{x + 11:.1f}" cy="{y:.1f}" r="{self.radius:g}"/>'


@dataclass(frozen=True)
class Level:
    """A horizontal line across the panel at y."""

    y: float
    label: str = ""
    style: str = "level"

    def extent(self) -> tuple[Array, Array]:
        return np.empty(0), np.array([self.y])

    def draw(self, x: Scale, y: Scale) -> str:
        return f'<path class="line {self.style}" d="M{x.start:.1f},{float(y(self.y)):.1f}H{x.end:.1f}"/>'

    def swatch(self, x: float, y: float) -> str:
        return f'<path class="line {self.style}" d="M{x:.1f},{y:.1f}h22"/>'


@dataclass(frozen=True)
class Band:
    """A horizontal band across the panel between two values of y."""

    low: float
    high: float
    label: str = ""
    style: str = "band"

    def extent(self) -> tuple[Array, Array]:
        return np.empty(0), np.array([self.low, self.high])

    def draw(self, x: Scale, y: Scale) -> str:
        top, bottom = np.sort(np.clip(y([self.low, self.high]), y.end, y.start))
        size = f'width="{x.end - x.start:.1f}" height="{bottom - top:.1f}"'
        return f'<rect class="{self.style}" x="{x.start:.1f}" y="{top:.1f}" {size}/>'

    def swatch(self, x: float, y: float) -> str:
        return f'<rect class="{self.style}" x="{x:.1f}" y="{y - 6:.1f}" width="22" height="12"/>'


@dataclass(frozen=True)
class Area:
    """The region between a lower curve (x_low, low) and an upper curve (x_high, high)."""

    x_low: Array
    low: Array
    x_high: Array
    high: Array
    label: str = ""
    style: str = "area"

    def extent(self) -> tuple[Array, Array]:
        return np.concatenate([self.x_low, self.x_high]), np.concatenate([self.low, self.high])

    def draw(self, x: Scale, y: Scale) -> str:
        px = np.concatenate([x(self.x_low), x(self.x_high[::-1])])
        py = np.concatenate([_clipped(y, self.low), _clipped(y, self.high[::-1])])
        return f'<path class="{self.style}" d="{polyline(px, py)}Z"/>'

    def swatch(self, x: float, y: float) -> str:
        return f'<rect class="{self.style}" x="{x:.1f}" y="{y - 6:.1f}" width="22" height="12"/>'


@dataclass(frozen=True)
class Image:
    """A picture (a data: address) stretched over (left, right) x (bottom, top)."""

    address: str
    left: float
    right: float
    bottom: float
    top: float
    label: str = ""
    style: str = "image"

    def extent(self) -> tuple[Array, Array]:
        return np.array([self.left, self.right]), np.array([self.bottom, self.top])

    def draw(self, x: Scale, y: Scale) -> str:
        (x0, x1), (y0, y1) = x([self.left, self.right]), y([self.top, self.bottom])
        box = f'x="{x0:.1f}" y="{y0:.1f}" width="{x1 - x0:.1f}" height="{y1 - y0:.1f}"'
        return f'<image {box} preserveAspectRatio="none" href="{self.address}"/>'

    def swatch(self, x: float, y: float) -> str:  # noqa: ARG002
        return ""  # a picture explains itself with a colour bar


def panel(
    title: str,
    x: Axis,
    y: Axis,
    marks: Sequence[Mark],
    *,
    size: tuple[int, int] = (560, 320),
    end_labels: bool = False,
    header: int = 0,
) -> Html:
    """One drawing: title, axes with ticks and units, the marks in order, and their names.

    Args:
        title: of the drawing. x, y: the axes. marks: to be drawn, the first one lowest.
        size: width and height in px at the nominal size of text.
        end_labels: write each mark's name at its right end instead of in a legend.
        header: px between title and axes, free for the caller.
    """
    width, height = size
    named = [mark for mark in marks if mark.label]
    rows = [] if end_labels else _legend_rows(named, width - 24.0)
    longest = max((len(mark.label) for mark in named), default=0)
    right = width - (12.0 + BOLD_CHARACTER * longest * end_labels)
    top = 30.0 + 20.0 * len(rows) + header
    height += 20 * max(0, len(rows) - 1)  # a long legend must not squeeze the drawing
    extents = [mark.extent() for mark in marks]
    sy = fitted_scale(y, np.concatenate([e[1] for e in extents] or [np.empty(0)]), height - 44.0, top)
    left = max(62.0, 26.0 + CHARACTER * max((len(tick_text(value)) for value in sy.ticks()), default=0))
    sx = fitted_scale(x, np.concatenate([e[0] for e in extents] or [np.empty(0)]), left, right - 2.0)
    drawn = "".join(mark.draw(sx, sy) for mark in marks)
    names = _end_labels(named, sx, sy) if end_labels else _legend(rows)
    frame = _title(title) + _grid(sx, sy) + drawn + _axis_labels(x, y, sx, sy, height) + names
    scale = " ".join(
        f"{v:.7g}" for v in (sx.low, sx.high, sx.start, sx.end, sy.low, sy.high, sy.start, sy.end)
    )
    kinds = f"{int(sx.log)} {int(sy.log)}"
    return Html(
        f'<svg class="panel" viewBox="0 0 {width} {height}" role="img" aria-label="{text(title)}" '
        f'data-scale="{scale} {kinds}">{frame}</svg>'
    )


def thinned(x: Array, y: Array, points: int = 700) -> tuple[Array, Array]:
    """About `points` points of a curve at most, in order, with both extremes of each interval."""
    if len(x) <= points:
        return x, y
    edges = np.linspace(0, len(x), points // 2 + 1).astype(int)
    indices: list[int] = [0]
    for start, stop in itertools.pairwise(edges):
        piece = np.nan_to_num(y[start:stop])
        indices += sorted({start + int(piece.argmin()), start + int(piece.argmax())})
    indices.append(len(x) - 1)
    index = np.unique(indices)
    return x[index], y[index]


def polyline(px: Array, py: Array) -> str:
    """The `d` of a path through pixels (T,) and (T,); NaN breaks it."""
    parts, pen = [], "M"
    for a, b in zip(px, py, strict=True):
        if np.isfinite(a) and np.isfinite(b):
            parts.append(f"{pen}{a:.1f},{b:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(parts)


def _clipped(scale: Scale, values: Array) -> Array:
    """Pixels, clipped to the panel, so that an outlier stays visible on its edge."""
    return np.clip(scale(values), min(scale.start, scale.end), max(scale.start, scale.end))


def _title(title: str) -> str:
    return f'<text class="title" x="12" y="18">{text(title)}</text>' if title else ""


def _grid(sx: Scale, sy: Scale) -> str:
    parts = []
    for value in sy.ticks():
        py = float(sy(value))
        parts.append(f'<path class="grid-line" d="M{sx.start:.1f},{py:.1f}H{sx.end:.1f}"/>')
        parts.append(f'<text class="tick" x="{sx.start - 7:.1f}" y="{py + 4:.1f}" text-anchor="end">')
        parts.append(f"{tick_text(value)}</text>")
    for value in sx.ticks():
        px = float(sx(value))
        parts.append(f'<path class="grid-line" d="M{px:.1f},{sy.start:.1f}v5"/>')
        parts.append(f'<text class="tick" x="{px:.1f}" y="{sy.start + 18:.1f}" text-anchor="middle">')
        parts.append(f"{tick_text(value)}</text>")
    parts.append(f'<path class="axis-line" d="M{sx.start:.1f},{sy.end:.1f}V{sy.start:.1f}H{sx.end:.1f}"/>')
    return "".join(parts)


def _axis_labels(x: Axis, y: Axis, sx: Scale, sy: Scale, height: int) -> str:
    middle_x, middle_y = (sx.start + sx.end) / 2, (sy.start + sy.end) / 2
    return (
        f'<text class="axis" x="{middle_x:.1f}" y="{height - 8}" text-anchor="middle">{text(x.label)}</text>'
        f'<text class="axis" transform="translate(12,{middle_y:.1f})rotate(-90)" text-anchor="middle">'
        f"{text(y.label)}</text>"
    )


def _legend_rows(marks: Sequence[Mark], width: float) -> list[list[Mark]]:
    rows: list[list[Mark]] = []
    used = width
    for mark in marks:
        needed = 44.0 + CHARACTER * len(mark.label)
        if used + needed > width:
            rows.append([])
            used = 0.0
        rows[-1].append(mark)
        used += needed
    return rows


def _legend(rows: list[list[Mark]]) -> str:
    parts = []
    for index, row in enumerate(rows):
        x, y = 12.0, 36.0 + 20.0 * index
        for mark in row:
            parts.append(mark.swatch(x, y))
            parts.append(f'<text class="name" x="{x + 28:.1f}" y="{y + 4:.1f}">{text(mark.label)}</text>')
            x += 44.0 + CHARACTER * len(mark.label)
    return "".join(parts)


def _end_labels(marks: Sequence[Mark], sx: Scale, sy: Scale) -> str:
    """Names at the right end, moved apart where they would overlap."""
    ends = [float(_clipped(sy, mark.extent()[1])[-1]) for mark in marks]
    parts, above = [], -np.inf
    for py, mark in sorted(zip(ends, marks, strict=True), key=lambda pair: pair[0]):
        above = max(py + 4.0, above + 16.0)
        place = f'x="{sx.end + 8:.1f}" y="{above:.1f}"'
        parts.append(f'<text class="name end {mark.style}" {place}>{text(mark.label)}</text>')
    return "".join(parts)
