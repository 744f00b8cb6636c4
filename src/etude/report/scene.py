"""Scene of paths in their workspace: an orthographic drawing of a box, its paths, and their shadows on the
floor.

Lengths along x, y and z have the same scale, so shapes and slopes look true.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from etude.abilities import SupportsDrawing, SupportsFigure
from etude.limits.motion_limits import AxisLimit, NormLimit
from etude.protocols import Limit
from etude.report.markup import Html, text
from etude.report.png import VIRIDIS, colours
from etude.report.record import Record
from etude.report.scales import linear_ticks, tick_text
from etude.report.svg import CHARACTER, polyline
from etude.types import Array, Figure, Thing

AZIMUTH, ELEVATION = math.radians(-60.0), math.radians(24.0)
"""Of the eye as seen from the room's middle: x runs to the right, y into the page."""
SIZE = (400, 310)  # px
SIDES = {"left": 46.0, "right": 30.0, "top": 56.0, "bottom": 42.0}
SHADES = 12
"""Steps of colour along a path."""
STEM_S = 5.0  # between two lines down to the floor
STYLES = {"solid": "c5", "plane": "c7", "inside": "c8", "stand": "c8", "carried": "c3"}
LINE_PX = 16.0
"""Between two names, so that none lies on another."""
EYE = np.array([np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
"""Direction from the room towards the viewer."""


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
    """The box in which paths are drawn, m.

    Attributes:
        lower, upper: corners, m.
        radius: of a cylinder about z in the box, m; None without one.
        things: objects that limits show.
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    radius: float | None = None
    things: tuple[Thing, ...] = ()


def room_of(limits: Sequence[Limit], paths: Sequence[Path]) -> SceneBox:
    """The box of the position limits, enlarged to contain the paths."""
    points = np.concatenate([path.position for path in paths]) if paths else np.zeros((1, 3))
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    radius = None
    for limit in limits:
        if isinstance(limit, AxisLimit) and limit.order == 0 and len(limit.places) == 3:
            low, high = np.minimum(low, limit.lower), np.maximum(high, limit.upper)
        elif isinstance(limit, NormLimit) and limit.order == 0:
            radius = limit.upper
    margin = 0.05 * np.maximum(high - low, 1e-3) if not limits else 0.0
    (x0, y0, z0), (x1, y1, z1) = (low - margin).tolist(), (high + margin).tolist()
    return SceneBox((x0, y0, z0), (x1, y1, z1), radius, things_of(limits))


def things_of(limits: Sequence[Limit]) -> tuple[Thing, ...]:
    """Objects that the limits show."""
    return tuple(thing for limit in limits if isinstance(limit, SupportsDrawing) for thing in limit.things)


@dataclass(frozen=True)
class Camera:
    """Projection from the world in m to a drawing in px: `scale` px per m, the origin at `place`."""

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
    """One drawing: the workspace with ticks in m, paths, their shadows and their starts."""
    camera, height = camera_of(room)
    drawn = "".join(_path(camera, path, room.lower[2]) for path in paths)
    caption = f'<text class="title" x="12" y="18">{text(title)}</text>'
    caption += f'<text class="tick" x="12" y="38">{text(note)}</text>' if note else ""
    return Html(
        f'<svg class="scene" viewBox="0 0 {SIZE[0]} {height:.0f}" role="img" aria-label="{text(title)}">'
        f"{caption}{drawn_room(camera, room)}{fixed_objects(camera, room, room.things)}{drawn}</svg>"
    )


def _corners(room: SceneBox) -> Array:
    grid = np.meshgrid(*zip(room.lower, room.upper, strict=True), indexing="ij")
    return np.stack([axis.ravel() for axis in grid], axis=1)


def camera_of(room: SceneBox, size: tuple[int, int] = SIZE) -> tuple[Camera, float]:
    """The camera that fills the drawing's width (or height, for a tall box), and the drawing's height, px."""
    image = project(_corners(room))
    low, span = image.min(axis=0), np.ptp(image, axis=0)
    free = (size[0] - SIDES["left"] - SIDES["right"], size[1] - SIDES["top"] - SIDES["bottom"])
    scale = min(free[0] / span[0], free[1] / span[1])
    margin = 0.5 * (free[0] - scale * span[0])
    height = SIDES["top"] + scale * span[1] + SIDES["bottom"]
    place = (SIDES["left"] + margin - scale * low[0], height - SIDES["bottom"] + scale * low[1])
    return Camera(float(scale), (float(place[0]), float(place[1]))), float(height)


def drawn_room(camera: Camera, room: SceneBox) -> str:
    """Floor, two walls, and ticks in m with their labels."""
    (x0, y0, z0), (x1, y1, z1) = room.lower, room.upper
    ticks = [
        linear_ticks(low, high, count)
        for low, high, count in zip(room.lower, room.upper, (4, 4, 2), strict=True)
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
    return _label(camera, at, tick_text(value), shift, anchor, "tick")


def _name(
    camera: Camera, at: tuple[float, float, float], name: str, shift: tuple[float, float], anchor: str
) -> str:
    return _label(camera, at, name, shift, anchor, "axis")


def _label(
    camera: Camera,
    at: tuple[float, float, float],
    content: str,
    shift: tuple[float, float],
    anchor: str,
    style: str,
) -> str:
    px, py = camera(np.array([at]))[0] + np.array(shift)
    return f'<text class="{style}" x="{px:.1f}" y="{py:.1f}" text-anchor="{anchor}">{text(content)}</text>'


def _path(camera: Camera, path: Path, floor: float) -> str:
    """Shadow, stems, the path, and an outline that sets it off on light and dark paper."""
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
    """Polylines of one colour each; steps of `SHADES` are too small to be visible."""
    step = np.clip(np.nan_to_num(shade) * SHADES, 0, SHADES - 1).astype(int)[:-1]
    parts = []
    for start, stop in pairwise([0, *(np.flatnonzero(np.diff(step)) + 1).tolist(), len(step)]):
        if stop > start:
            red, green, blue = colours(np.array((step[start] + 0.5) / SHADES), VIRIDIS)
            line = polyline(*pixels[start : stop + 1].T)
            parts.append(f'<path class="track" style="stroke:#{red:02x}{green:02x}{blue:02x}" d="{line}"/>')
    return parts


def fixed_objects(camera: Camera, room: SceneBox, things: Sequence[Thing]) -> str:
    """The fixed objects with names, far ones first."""
    still = [thing for thing in things if thing.kind != "carried"]
    drawn = {thing.name: faces_in(thing, room) for thing in still}
    shown = [thing for thing in still if drawn[thing.name]]
    shown.sort(key=lambda thing: (thing.kind == "solid", _depth(drawn[thing.name])))
    parts = [_thing(camera, thing, drawn[thing.name]) for thing in shown]
    marks = [(_mark(camera, thing, drawn[thing.name]), thing.name) for thing in shown]
    return "".join([*parts, _names(marks)])


def clipped_polygon(face: Array, lower: Array, upper: Array) -> Array:
    """Part (V', 3) of a convex polygon (V, 3) or a line (2, 3) between two corners (3,), m; maybe empty."""
    for axis in range(3):
        face = _half(face, axis, float(lower[axis]), 1.0)
        face = _half(face, axis, float(upper[axis]), -1.0)
    return face


def _half(face: Array, axis: int, end: float, side: float) -> Array:
    """Its part on one side of a plane across an axis: beyond `end` for side 1, before it for -1."""
    beyond = side * (face[:, axis] - end)
    vertices: list[Array] = []
    for k in range(len(face)):
        after = (k + 1) % len(face)
        if beyond[k] >= 0.0:
            vertices.append(face[k])
        if beyond[k] * beyond[after] < 0.0:
            share = beyond[k] / (beyond[k] - beyond[after])
            vertices.append(face[k] + share * (face[after] - face[k]))
    return np.array(vertices).reshape(-1, 3)


def faces_in(thing: Thing, room: SceneBox) -> list[Array]:
    """Faces (V, 3) of an object inside the box, m."""
    points, lower, upper = thing.points[0], np.array(room.lower), np.array(room.upper)
    clipped = [clipped_polygon(points[list(face)], lower - 1e-9, upper + 1e-9) for face in thing.faces]
    return [face for face in clipped if len(face) > 1]


def _depth(faces: list[Array]) -> float:
    return float(np.concatenate(faces).mean(axis=0) @ EYE)


def _thing(camera: Camera, thing: Thing, faces: list[Array]) -> str:
    """Faces of an object. Hidden faces of a solid are dashed behind the others; a room has edges alone."""
    style = f"thing {thing.kind} {STYLES[thing.kind]}"
    middle = np.concatenate(faces).mean(axis=0)
    paths = [(_looks_here(face, middle), f"{polyline(*camera(face).T)}Z") for face in faces]
    hidden = [line for here, line in paths if not here and thing.kind == "solid"]
    front = [line for here, line in paths if here or thing.kind != "solid"]
    back = f'<path class="{style} behind" d="{"".join(hidden)}"/>' if hidden else ""
    return f'<g>{back}<path class="{style}" d="{"".join(front)}"/><title>{text(thing.name)}</title></g>'


def _looks_here(face: Array, middle: Array) -> bool:
    """Whether the outer side of a face faces the viewer, for a body around `middle`."""
    if len(face) < 3:
        return True
    normal = np.cross(face[1] - face[0], face[2] - face[0])
    return bool((normal @ EYE) * (normal @ (face[0] - middle)) > 0.0)


def _mark(camera: Camera, thing: Thing, faces: list[Array]) -> tuple[float, float]:
    """Place of the name, px: on top of a solid, below a base's foot, at the near corner of other objects."""
    points = np.concatenate(faces)
    if thing.kind == "solid":
        top = points[points[:, 2] > points[:, 2].max() - 1e-9]
        x, y = camera(top.mean(axis=0)[None])[0]
        return float(x), float(y)
    pixels = camera(points)
    x, y = pixels[int(np.argmax(pixels[:, 1]))]
    return float(x), float(y) + (14.0 if thing.kind == "stand" else -8.0)


def _names(marks: list[tuple[tuple[float, float], str]]) -> str:
    """Names at the objects, moved up where they would overlap."""
    placed: list[tuple[float, float, float]] = []
    parts = []
    for (x, y), name in sorted(marks, key=lambda mark: -mark[0][1]):
        half = 0.5 * CHARACTER * len(name)
        x = min(max(x, half + 6.0), 394.0 - half)
        while any(abs(x - a) < half + b and abs(y - c) < LINE_PX for a, b, c in placed):
            y -= LINE_PX
        placed.append((x, half, y))
        parts.append(
            f'<text class="thing-name" x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{text(name)}</text>'
        )
    return "".join(parts)


def figure_along(record: Record, path: Array) -> Figure | None:
    """The robot along poses (T, k) with its surroundings; None if it cannot be drawn."""
    campaign = record.campaign
    if campaign is None or not isinstance(campaign.kind, SupportsFigure):
        return None
    figure = campaign.kind.figure(campaign.spec, path)
    return figure and replace(figure, things=(*figure.things, *things_of(record.limits)))


BEYOND = 0.5
"""Of the robot's own extent: how much farther out things are drawn, which may be as large as a hall."""
DEEPER = 4.0
"""Times that, of a floor, a wall, and the line from a base down to its floor."""
SLACK = 1e-3
"""m that a robot may be in its floor for rounding."""


def room_around(figure: Figure) -> SceneBox:
    """A box around the motion and near objects; its floor is the robot's floor, or lower."""
    moving = [figure.points, *(thing.points for thing in figure.things if thing.kind == "carried")]
    low = np.min([points.min(axis=(0, 1)) for points in moving], axis=0)
    high = np.max([points.max(axis=(0, 1)) for points in moving], axis=0)
    margin = 0.05 * max(float((high - low).max()), 0.1)
    lower, upper = low - margin, high + margin
    reach = BEYOND * float((high - low).max())
    for thing in figure.things:
        # planes and what the robot stands on take no width of the drawing, and tell what the rest hangs above
        extent = reach * (DEEPER if thing.kind in ("plane", "stand") else 1.0)
        near = _near(thing, low - extent, high + extent)
        if len(near):
            lower, upper = np.minimum(lower, near.min(axis=0)), np.maximum(upper, near.max(axis=0))
    lower[2] = _bottom(figure, float(low[2]), float(lower[2]))
    (x0, y0, z0), (x1, y1, z1) = lower.tolist(), upper.tolist()
    return SceneBox((x0, y0, z0), (x1, y1, z1))


def _bottom(figure: Figure, lowest: float, lower: float) -> float:
    """Height of the drawing's floor, m: the robot's own floor, if drawn and below all of the robot."""
    floors = [one for one in figure.things if one.kind == "plane" and one.name == "floor"]
    height = float(floors[0].points[0, 0, 2]) if floors else 0.0
    shown = not floors or height >= lower - SLACK
    return height if shown and lowest > height - SLACK else lower


def _near(thing: Thing, lower: Array, upper: Array) -> Array:
    """Points (V, 3) m that the drawing must contain: the foot of a plane, none of a room."""
    if thing.kind in ("carried", "inside"):
        return np.empty((0, 3))
    if thing.kind == "plane":
        foot = thing.points[0].mean(axis=0, keepdims=True)
        within = bool(np.all((foot >= lower) & (foot <= upper)))
        return np.asarray(foot if within else foot[:0])
    return np.concatenate(
        [clipped_polygon(thing.points[0][list(face)], lower, upper) for face in thing.faces]
    )


def beyond(figure: Figure) -> list[str]:
    """Names of the objects too far from the robot to be drawn."""
    room = room_around(figure)
    return [thing.name for thing in figure.things if thing.kind != "carried" and not faces_in(thing, room)]
