"""A path in its room: an orthographic drawing of a box, with paths in it and their shadows on the floor.

Lengths along x, y and z have the same scale, so shapes and climbs look as they were flown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from etude.protocols import Limit
from etude.report.markup import Html, text
from etude.report.png import VIRIDIS, colours
from etude.report.scales import linear_ticks, tick_text
from etude.report.svg import polyline
from etude.types import Array

AZIMUTH, ELEVATION = math.radians(-60.0), math.radians(24.0)
"""Of the eye as seen from the room's middle: x runs to the right, y into the page."""
SIZE = (400, 310)
SIDES = {"left": 46.0, "right": 30.0, "top": 56.0, "bottom": 42.0}
SHADES = 12
"""Steps of colour along a path."""
STEM_S = 5.0


@dataclass(frozen=True)
class Path:
    """A flown or planned path.

    Attributes:
        t: (T,) s.
        position: (T, 3) m.
        shade: (T,) in [0, 1], the colour along it; None for one colour.
    """

    t: Array
    position: Array
    shade: Array | None = None


@dataclass(frozen=True)
class SceneBox:
    """The box in which paths are drawn, m, and the radius of a cylinder about z in it, if there is one."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    radius: float | None = None


def room_of(limits: Sequence[Limit], paths: Sequence[Path]) -> SceneBox:
    """The room that position limits state, widened to hold the paths."""
    points = np.concatenate([path.position for path in paths]) if paths else np.zeros((1, 3))
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    radius = None
    for limit in limits:
        stated_low: Any = getattr(limit, "lower", None)
        stated_high: Any = getattr(limit, "upper", None)
        if getattr(limit, "order", None) != 0 or stated_high is None:
            continue
        if np.shape(stated_high) == (3,):
            low, high = np.minimum(low, stated_low), np.maximum(high, stated_high)
        elif np.ndim(stated_high) == 0:
            radius = float(stated_high)
    spare = 0.05 * np.maximum(high - low, 1e-3) if not limits else 0.0
    (x0, y0, z0), (x1, y1, z1) = (low - spare).tolist(), (high + spare).tolist()
    return SceneBox((x0, y0, z0), (x1, y1, z1), radius)


@dataclass(frozen=True)
class Camera:
    """From the world in m to a drawing in px: `scale` px per m, the origin at `place`."""

    scale: float
    place: tuple[float, float]

    def __call__(self, points: Array) -> Array:
        """(T, 2) px of points (T, 3)."""
        flat = project(points) * self.scale
        return np.asarray(np.array(self.place) + flat * [1.0, -1.0])


def project(points: Array) -> Array:
    """(T, 2) orthographic image, right and up in m, of points (T, 3) in the world frame (z up)."""
    sa, ca, se, ce = math.sin(AZIMUTH), math.cos(AZIMUTH), math.sin(ELEVATION), math.cos(ELEVATION)
    right, up = np.array([-sa, ca, 0.0]), np.array([-se * ca, -se * sa, ce])
    return np.asarray(points @ np.stack([right, up], axis=1))


def scene(title: str, room: SceneBox, paths: Sequence[Path], *, note: str = "") -> Html:
    """One drawing: the robot's room with ticks in m, paths, their shadows and where they start."""
    camera, height = camera_of(room)
    drawn = "".join(_path(camera, path, room.lower[2]) for path in paths)
    words = f'<text class="title" x="12" y="18">{text(title)}</text>'
    words += f'<text class="tick" x="12" y="38">{text(note)}</text>' if note else ""
    return Html(
        f'<svg class="scene" viewBox="0 0 {SIZE[0]} {height:.0f}" role="img" aria-label="{text(title)}">'
        f"{words}{drawn_room(camera, room)}{drawn}</svg>"
    )


def _corners(room: SceneBox) -> Array:
    grid = np.meshgrid(*zip(room.lower, room.upper, strict=True), indexing="ij")
    return np.stack([axis.ravel() for axis in grid], axis=1)


def camera_of(room: SceneBox, size: tuple[int, int] = SIZE) -> tuple[Camera, float]:
    """The camera that fills the drawing's width, or its height where the room is tall; and the height."""
    image = project(_corners(room))
    low, span = image.min(axis=0), np.ptp(image, axis=0)
    free = (size[0] - SIDES["left"] - SIDES["right"], size[1] - SIDES["top"] - SIDES["bottom"])
    scale = min(free[0] / span[0], free[1] / span[1])
    spare = 0.5 * (free[0] - scale * span[0])
    height = SIDES["top"] + scale * span[1] + SIDES["bottom"]
    place = (SIDES["left"] + spare - scale * low[0], height - SIDES["bottom"] + scale * low[1])
    return Camera(float(scale), (float(place[0]), float(place[1]))), float(height)


def drawn_room(camera: Camera, room: SceneBox) -> str:
    """Floor, two walls, ticks in m and what they are of."""
    (x0, y0, z0), (x1, y1, z1) = room.lower, room.upper
    ticks = [
        linear_ticks(low, high, wanted)
        for low, high, wanted in zip(room.lower, room.upper, (4, 4, 2), strict=True)
    ]
    lines = [_line(camera, [(x, y0, z0), (x, y1, z0)], "grid-line") for x in ticks[0]]
    lines += [_line(camera, [(x0, y, z0), (x1, y, z0)], "grid-line") for y in ticks[1]]
    lines += [_line(camera, [(x0, y0, z), (x0, y1, z), (x1, y1, z)], "grid-line") for z in ticks[2]]
    lines += [_line(camera, [(x0, y1, z0), (x0, y1, z1)], "axis-line")]
    floor = [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0), (x0, y0, z0)]
    roof = [(x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x1, y1, z1), (x1, y1, z0)]
    lines += [_line(camera, floor, "axis-line"), _line(camera, roof, "axis-line")]
    if room.radius is not None:
        lines += [_line(camera, _ring(room.radius, z), "limit") for z in (z0, z1)]
    marks = [_tick(camera, (x, y0, z0), x, (0.0, 15.0), "middle") for x in ticks[0][1:]]
    marks += [_tick(camera, (x1, y, z0), y, (7.0, 8.0), "start") for y in ticks[1][1:]]
    marks += [_tick(camera, (x0, y0, z), z, (-7.0, 4.0), "end") for z in ticks[2]]
    names = [
        _name(camera, (0.5 * (x0 + x1), y0, z0), "x (m)", (-14.0, 33.0), "middle"),
        _name(camera, (x1, 0.5 * (y0 + y1), z0), "y (m)", (22.0, 26.0), "start"),
        _name(camera, (x0, y0, z1), "z (m)", (-4.0, -10.0), "end"),
    ]
    return "".join([*lines, *marks, *names])


def _ring(radius: float, z: float) -> list[tuple[float, float, float]]:
    return [(radius * math.cos(a), radius * math.sin(a), z) for a in np.linspace(0.0, 2.0 * math.pi, 73)]


def _line(camera: Camera, points: Sequence[tuple[float, float, float]], style: str) -> str:
    return f'<path class="line {style}" d="{polyline(*camera(np.array(points)).T)}"/>'


def _tick(
    camera: Camera, at: tuple[float, float, float], value: float, shift: tuple[float, float], anchor: str
) -> str:
    return _words(camera, at, tick_text(value), shift, anchor, "tick")


def _name(
    camera: Camera, at: tuple[float, float, float], name: str, shift: tuple[float, float], anchor: str
) -> str:
    return _words(camera, at, name, shift, anchor, "axis")


def _words(
    camera: Camera,
    at: tuple[float, float, float],
    words: str,
    shift: tuple[float, float],
    anchor: str,
    style: str,
) -> str:
    px, py = camera(np.array([at]))[0] + np.array(shift)
    return f'<text class="{style}" x="{px:.1f}" y="{py:.1f}" text-anchor="{anchor}">{text(words)}</text>'


def _path(camera: Camera, path: Path, floor: float) -> str:
    """Shadow, stems, a casing that sets every colour off against light and dark paper, and the path."""
    good = np.isfinite(path.position).all(axis=1)
    t, position = path.t[good], path.position[good]
    if not len(t):
        return ""
    pixels = camera(position)
    ground = camera(np.column_stack([position[:, :2], np.full(len(t), floor)]))
    stems = np.searchsorted(t, np.arange(t[0], t[-1], STEM_S))
    parts = [f'<path class="shadow" d="{polyline(*ground.T)}"/>']
    parts += [f'<path class="stem" d="{polyline(*np.array([pixels[i], ground[i]]).T)}"/>' for i in stems]
    parts.append(f'<path class="casing" d="{polyline(*pixels.T)}"/>')
    parts += [f'<path class="track c1" d="{polyline(*pixels.T)}"/>'] if path.shade is None else []
    if path.shade is not None:
        parts += _shaded(pixels, path.shade[good])
    px, py = pixels[0]
    parts.append(f'<circle class="start" cx="{px:.1f}" cy="{py:.1f}" r="5"><title>start</title></circle>')
    return "".join(parts)


def _shaded(pixels: Array, shade: Array) -> list[str]:
    """Polylines of one colour each; a step of `SHADES` is too small to be seen."""
    step = np.clip(np.nan_to_num(shade) * SHADES, 0, SHADES - 1).astype(int)[:-1]
    parts = []
    for start, stop in pairwise([0, *(np.flatnonzero(np.diff(step)) + 1).tolist(), len(step)]):
        if stop > start:
            red, green, blue = colours(np.array((step[start] + 0.5) / SHADES), VIRIDIS)
            line = polyline(*pixels[start : stop + 1].T)
            parts.append(f'<path class="track" style="stroke:#{red:02x}{green:02x}{blue:02x}" d="{line}"/>')
    return parts
