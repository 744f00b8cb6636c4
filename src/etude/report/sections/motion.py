"""The robot along its newest trajectory: a figure of sticks that moves; without a script, some poses."""

from __future__ import annotations

import json

import numpy as np

from etude.errors import EtudeError
from etude.protocols import Trajectory
from etude.report.markup import Html, element, missing, paragraph, section, text
from etude.report.record import Record
from etude.report.scene import Camera, camera_of, drawn_room, project
from etude.report.sections.around import beyond, carried_pose, legend, room_around, standing
from etude.report.svg import polyline
from etude.types import Array, Figure

FRAMES_PER_S = 10.0
MOST_FRAMES = 900
SIZE = (400, 430)
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
    draw = getattr(record.campaign.kind, "figure", None) if record.campaign else None
    if trajectory is None or draw is None or record.campaign is None:
        return Html("")
    t = frames(trajectory)
    path = trajectory.motion(t, 1).orders[0]
    if path.shape[1] != len(record.names):
        return Html("")
    try:
        found: Figure | None = draw(record.campaign.spec, path)
    except EtudeError as error:
        return section("motion", TITLE, missing(f"The robot cannot be drawn: {error}"))
    if found is None:
        return Html("")
    words = "its tip" if len(found.tips) == 1 else "its tips"
    drawn = stage(f"Trajectory {numbers[-1]}", t, found)
    return section("motion", TITLE, paragraph(TEXT.format(tips=words)), paragraph(_of_things(found)), drawn)


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
    things = standing(camera, room, figure)
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
    pixels = camera(figure.points[k])
    line = "".join(
        f"M{pixels[a][0]:.1f} {pixels[a][1]:.1f}L{pixels[b][0]:.1f} {pixels[b][1]:.1f}"
        for a, b in figure.sticks.tolist()
    )
    return f'<path class="{style}" d="{line}"/>'


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
