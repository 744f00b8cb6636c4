"""The robot along its newest trajectory as a figure of sticks, with what stands around it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from etude.abilities import SupportsFigure
from etude.errors import EtudeError
from etude.protocols import Trajectory
from etude.report.markup import Html, element, missing, paragraph, section, text
from etude.report.record import Record
from etude.report.scene import (
    STYLES,
    Camera,
    SceneBox,
    camera_of,
    cut,
    drawn_room,
    faces_in,
    project,
    standing,
    things_of,
)
from etude.report.svg import CHARACTER, polyline
from etude.types import Array, Figure, Thing

FRAMES_PER_S = 10.0  # between which a browser draws straight on
MOST_FRAMES = 900  # at FRAMES_PER_S, a motion of 90 s
SIZE = (400, 430)  # px
GHOSTS = 6
"""Poses that are drawn faintly, for who wants or gets no animation."""
TITLE = "The robot along the motion"
TEXT = (
    "The joints and the links between them along the newest trajectory as it was planned, with the path of "
    "{tips} and its shadow on the floor: sticks, not shapes, from the base, the ring. Faint are poses "
    "on the way. "
    "It moves at its own speed; where your system asks for less motion it stands until you start it."
)
AROUND = (
    "Around it is what robot.toml names: {names}. A motion may pass before or behind a thing and seem to "
    "touch it: how near the shapes come is in the trajectory's certificate."
)
NOTHING = "robot.toml names no floor, box or wall, so none is drawn, and no motion keeps away from any."
TOO_FAR = "Too far away to be drawn: {names}."


def motion(record: Record) -> Html:
    """One drawing; nothing for robots that cannot be drawn."""
    numbers = [n for n, r in sorted(record.state.rounds.items()) if r.asked is not None]
    trajectory = record.trajectory(numbers[-1]) if numbers else None
    if trajectory is None:
        return Html("")
    t = frames(trajectory)
    path = trajectory.motion(t, 1).orders[0]
    if path.shape[1] != len(record.names):
        return Html("")
    try:
        found = figure_along(record, path)
    except EtudeError as error:
        return section("motion", TITLE, missing(f"The robot cannot be drawn: {error}"))
    if found is None:
        return Html("")
    words = "its tip" if len(found.tips) == 1 else "its tips"
    drawn = stage(f"Trajectory {numbers[-1]}", t, found)
    return section("motion", TITLE, paragraph(TEXT.format(tips=words)), paragraph(_of_things(found)), drawn)


def figure_along(record: Record, path: Array) -> Figure | None:
    """The robot along poses (T, k), with what stands around it; None where it cannot be drawn."""
    campaign = record.campaign
    if campaign is None or not isinstance(campaign.kind, SupportsFigure):
        return None
    found = campaign.kind.figure(campaign.spec, path)
    return found and replace(found, things=(*found.things, *things_of(record.limits)))


BEYOND = 0.5
"""Of the robot's own extent: how much farther out things are drawn, which may be as large as a hall."""
DEEPER = 4.0
"""Times that, of a floor, a wall, and the line from a base down to its floor."""
SLACK = 1e-3
"""m that a robot may be in its floor for rounding."""
CARRIED = {"tool": "c3", "payload": "c4"}


def room_around(figure: Figure) -> SceneBox:
    """A box around the motion and what is near it; its floor is where the robot stands, or below it."""
    moving = [figure.points, *(thing.points for thing in figure.things if thing.kind == "carried")]
    low = np.min([points.min(axis=(0, 1)) for points in moving], axis=0)
    high = np.max([points.max(axis=(0, 1)) for points in moving], axis=0)
    margin = 0.05 * max(float((high - low).max()), 0.1)
    lower, upper = low - margin, high + margin
    reach = BEYOND * float((high - low).max())
    for thing in figure.things:
        # planes and what the robot stands on take no width of the drawing, and tell what the rest hangs above
        own = reach * (DEEPER if thing.kind in ("plane", "stand") else 1.0)
        near = _near(thing, low - own, high + own)
        if len(near):
            lower, upper = np.minimum(lower, near.min(axis=0)), np.maximum(upper, near.max(axis=0))
    lower[2] = _bottom(figure, float(low[2]), float(lower[2]))
    (x0, y0, z0), (x1, y1, z1) = lower.tolist(), upper.tolist()
    return SceneBox((x0, y0, z0), (x1, y1, z1))


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
    return [thing.name for thing in figure.things if thing.kind != "carried" and not faces_in(thing, room)]


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


def _of_things(figure: Figure) -> str:
    """What is drawn beside the robot, and what is not."""
    around = [thing.name for thing in figure.things if thing.kind in ("solid", "plane", "inside")]
    carried = [f"the {thing.name} that it carries" for thing in figure.things if thing.kind == "carried"]
    far = beyond(figure)
    seen = [name for name in around if name not in far] + carried
    said = [AROUND.format(names=", ".join(seen))] if seen else []
    said += [NOTHING] if not around else []
    return " ".join([*said, *([TOO_FAR.format(names=", ".join(far))] if far else [])])


def frames(trajectory: Trajectory) -> Array:
    """(T,) s: the times that are drawn."""
    count = int(min(MOST_FRAMES, max(2, np.ceil(trajectory.duration * FRAMES_PER_S) + 1)))
    return np.linspace(0.0, trajectory.duration, count)


def stage(title: str, t: Array, figure: Figure) -> Html:
    """The figure among what stands around it, with buttons that the page's script shows."""
    room = room_around(figure)
    camera, height = camera_of(room, SIZE)
    things = standing(camera, room, figure.things)
    ghosts = np.linspace(0, len(t) - 1, GHOSTS + 2).round().astype(int)[1:-1]
    parts = [drawn_room(camera, room), things]
    parts += [_pose(camera, figure, k, "ghost") for k in ghosts.tolist()]
    parts += [_way(camera, figure.points[:, tip], room.lower[2]) for tip in figure.tips]
    x, y = camera(figure.points[0, :1])[0]
    parts.append(f'<circle class="start" cx="{x:.1f}" cy="{y:.1f}" r="5"><title>base</title></circle>')
    carried = [thing for thing in figure.things if thing.kind == "carried"]
    moving = _pose(camera, figure, 0, "limb c1") + "".join(carried_pose(camera, one, 0) for one in carried)
    parts.append(f'<g class="robot">{moving}</g>')
    name = f'<text class="title" x="12" y="18">{text(title)}</text>{legend(figure, 38.0)}'
    box = f'viewBox="0 0 {SIZE[0]} {height:.0f}" role="img" aria-label="{text(title)}, as a figure of sticks"'
    svg = Html(f'<svg class="scene" {box}>{name}{"".join(parts)}</svg>')
    return element("figure", svg, _buttons(t), class_="stage", **{"data-motion": _data(camera, t, figure)})


def _buttons(t: Array) -> Html:
    return element(
        "div",
        element("button", "Play", type="button", class_="play"),
        Html(f'<input type="range" min="0" max="{t[-1]:.6g}" step="any" value="0" aria-label="time">'),
        element("output", "0.0 s"),
        class_="transport",
        hidden="hidden",
    )


def _way(camera: Camera, way: Array, floor: float) -> str:
    """The path (T, 3) of a tip, and its shadow."""
    ground = np.column_stack([way[:, :2], np.full(len(way), floor)])
    shadow = f'<path class="shadow" d="{polyline(*camera(ground).T)}"/>'
    return f'{shadow}<path class="trail c2" d="{polyline(*camera(way).T)}"/>'


def _pose(camera: Camera, figure: Figure, k: int, style: str) -> str:
    """Sticks and joints at one time."""
    return f'<path class="{style}" d="{sticks(camera, figure, k)}"/>'


def sticks(camera: Camera, figure: Figure, k: int) -> str:
    """The `d` of a path along the sticks at one time."""
    pixels = camera(figure.points[k])
    return "".join(
        f"M{pixels[a][0]:.1f} {pixels[a][1]:.1f}L{pixels[b][0]:.1f} {pixels[b][1]:.1f}"
        for a, b in figure.sticks.tolist()
    )


def _data(camera: Camera, t: Array, figure: Figure) -> str:
    """What the script needs: tenths of px of every point at every time, which of them sticks join, and the
    faces of each thing that is carried.
    """
    groups, faces, first = [figure.points], [], figure.points.shape[1]
    for thing in figure.things:
        if thing.kind == "carried":
            groups.append(thing.points)
            faces.append([[first + point for point in face] for face in thing.faces])
            first += thing.points.shape[1]
    points = np.concatenate(groups, axis=1)
    flat = project(points.reshape(-1, 3)) * camera.scale * [1.0, -1.0] + np.array(camera.place)
    pixels = np.rint(10.0 * flat).astype(int).reshape(len(t), -1)
    facts = {"step": float(t[1] - t[0]), "sticks": figure.sticks.ravel().tolist(), "carried": faces}
    return json.dumps({**facts, "pixels": pixels.ravel().tolist()}, separators=(",", ":"))
