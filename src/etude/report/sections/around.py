"""What stands around a robot, and what it carries, in the drawing of its motion."""

from __future__ import annotations

import numpy as np

from etude.report.markup import text
from etude.report.polygons import cut
from etude.report.scene import AZIMUTH, ELEVATION, Camera, Room
from etude.report.svg import CHARACTER, polyline
from etude.types import Array, Figure, Thing

BEYOND = 0.5
"""Of the robot's own extent: how much farther out things are drawn, which may be as large as a hall."""
DEEPER = 4.0
"""Times that, of a floor, a wall, and the line from a base down to its floor."""
SLACK = 1e-3
"""m that a robot may be in its floor for rounding."""
LINE_PX = 16.0
"""Between two names, so that none lies on another."""
STYLES = {"solid": "c5", "plane": "c7", "inside": "c8", "stand": "c8", "carried": "c3"}
CARRIED = {"tool": "c3", "payload": "c4"}
EYE = np.array([np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
"""From the room towards who looks."""


def room_around(figure: Figure) -> Room:
    """A box around the motion and what is near it; its floor is where the robot stands, or below it."""
    moving = [figure.points, *(thing.points for thing in figure.things if thing.kind == "carried")]
    low = np.min([points.min(axis=(0, 1)) for points in moving], axis=0)
    high = np.max([points.max(axis=(0, 1)) for points in moving], axis=0)
    spare = 0.05 * max(float((high - low).max()), 0.1)
    lower, upper = low - spare, high + spare
    reach = BEYOND * float((high - low).max())
    for thing in figure.things:
        # planes and what the robot stands on take no width of the drawing, and tell what the rest hangs above
        own = reach * (DEEPER if thing.kind in ("plane", "stand") else 1.0)
        near = _near(thing, low - own, high + own)
        if len(near):
            lower, upper = np.minimum(lower, near.min(axis=0)), np.maximum(upper, near.max(axis=0))
    lower[2] = _bottom(figure, float(low[2]), float(lower[2]))
    (x0, y0, z0), (x1, y1, z1) = lower.tolist(), upper.tolist()
    return Room((x0, y0, z0), (x1, y1, z1))


def _bottom(figure: Figure, lowest: float, lower: float) -> float:
    """m: the drawing's floor is the robot's, where that is drawn and nothing of the robot is below it."""
    floors = [one for one in figure.things if one.kind == "plane" and one.name == "floor"]
    height = float(floors[0].points[0, 0, 2]) if floors else 0.0
    shown = not floors or height >= lower - SLACK
    return height if shown and lowest > height - SLACK else lower


def _near(thing: Thing, lower: Array, upper: Array) -> Array:
    """(V, 3) the points that the drawing is widened to hold; of a plane its foot, of a room nothing."""
    if thing.kind in ("carried", "inside"):
        return np.empty((0, 3))
    if thing.kind == "plane":
        foot = thing.points[0].mean(axis=0, keepdims=True)
        within = bool(np.all((foot >= lower) & (foot <= upper)))
        return np.asarray(foot if within else foot[:0])
    return np.concatenate([cut(thing.points[0][list(face)], lower, upper) for face in thing.faces])


def beyond(figure: Figure) -> list[str]:
    """Names of what is too far away from the robot to be drawn with it."""
    room = room_around(figure)
    return [thing.name for thing in figure.things if thing.kind != "carried" and not _faces(thing, room)]


def standing(camera: Camera, room: Room, figure: Figure) -> str:
    """What stands still, the far first, with names."""
    still = [thing for thing in figure.things if thing.kind != "carried"]
    drawn = {thing.name: _faces(thing, room) for thing in still}
    shown = [thing for thing in still if drawn[thing.name]]
    shown.sort(key=lambda thing: (thing.kind == "solid", _depth(drawn[thing.name])))
    parts = [_thing(camera, thing, drawn[thing.name]) for thing in shown]
    marks = [(_mark(camera, thing, drawn[thing.name]), thing.name) for thing in shown]
    return "".join([*parts, _names(marks)])


def carried_pose(camera: Camera, thing: Thing, k: int) -> str:
    """The path of what is carried at one time."""
    pixels = camera(thing.points[k])
    line = "".join(f"{polyline(*pixels[list(face)].T)}Z" for face in thing.faces)
    return f'<path class="carried {carried_style(thing)}" d="{line}"/>'


def carried_style(thing: Thing) -> str:
    return CARRIED.get(thing.name, STYLES["carried"])


def legend(figure: Figure, y: float) -> str:
    """Swatches of what moves: the arm, and what it carries, which cannot be named where they are."""
    moving = [thing for thing in figure.things if thing.kind == "carried"]
    parts, x = [], 12.0
    for name, style in [("arm", "limb c1"), *((t.name, f"carried {carried_style(t)}") for t in moving)]:
        parts.append(f'<path class="{style}" d="M{x:.1f} {y:.1f}h18"/>')
        parts.append(f'<text class="name" x="{x + 26:.1f}" y="{y + 4:.1f}">{text(name)}</text>')
        x += 44.0 + CHARACTER * len(name)
    return "".join(parts) if moving else ""


def _faces(thing: Thing, room: Room) -> list[Array]:
    """(V, 3) each: the faces as far as they lie in the room."""
    points, lower, upper = thing.points[0], np.array(room.lower), np.array(room.upper)
    found = [cut(points[list(face)], lower - 1e-9, upper + 1e-9) for face in thing.faces]
    return [face for face in found if len(face) > 1]


def _depth(faces: list[Array]) -> float:
    return float(np.concatenate(faces).mean(axis=0) @ EYE)


def _thing(camera: Camera, thing: Thing, faces: list[Array]) -> str:
    """Its faces: those of a solid that look away are dashed behind the others, a room is edges alone."""
    style = f"thing {thing.kind} {STYLES[thing.kind]}"
    middle = np.concatenate(faces).mean(axis=0)
    paths = [(_looks_here(face, middle), f"{polyline(*camera(face).T)}Z") for face in faces]
    hidden = [line for here, line in paths if not here and thing.kind == "solid"]
    front = [line for here, line in paths if here or thing.kind != "solid"]
    back = f'<path class="{style} behind" d="{"".join(hidden)}"/>' if hidden else ""
    return f'<g>{back}<path class="{style}" d="{"".join(front)}"/><title>{text(thing.name)}</title></g>'


def _looks_here(face: Array, middle: Array) -> bool:
    """Whether the outer side of a face of a body around `middle` looks to the eye."""
    if len(face) < 3:
        return True
    normal = np.cross(face[1] - face[0], face[2] - face[0])
    return bool((normal @ EYE) * (normal @ (face[0] - middle)) > 0.0)


def _mark(camera: Camera, thing: Thing, faces: list[Array]) -> tuple[float, float]:
    """px: where its name stands: on the top of a solid, at the near corner of others, below a base's foot."""
    points = np.concatenate(faces)
    if thing.kind == "solid":
        top = points[points[:, 2] > points[:, 2].max() - 1e-9]
        x, y = camera(top.mean(axis=0)[None])[0]
        return float(x), float(y)
    pixels = camera(points)
    x, y = pixels[int(np.argmax(pixels[:, 1]))]
    return float(x), float(y) + (14.0 if thing.kind == "stand" else -8.0)


def _names(marks: list[tuple[tuple[float, float], str]]) -> str:
    """Names where things are, moved up where one would lie on another."""
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
