"""Newest trajectory of the robot: in space, and as a stick figure with its surroundings."""

from __future__ import annotations

import numpy as np

from etude.errors import EtudeError
from etude.report.markup import Html, element, missing_data, paragraph, section, text
from etude.report.motion_in_space import in_space
from etude.report.record import Record
from etude.report.scene import (
    STYLES,
    Camera,
    beyond,
    camera_of,
    drawn_room,
    figure_along,
    fixed_objects,
    room_around,
)
from etude.report.space import describe_motion, figure_in_space
from etude.report.svg import CHARACTER, polyline
from etude.types import Array, Figure, Thing

FRAMES = 300
"""Instants that the path of a tip is drawn through: about one for each px."""
SIZE = (400, 430)  # px
GHOSTS = 6
"""Poses that are drawn faintly, for who wants or gets no animation."""
TITLE = "The robot along the motion"
TEXT = (
    "The joints and the links between them along the newest planned trajectory, with the path of {tips} "
    "and its shadow on the floor. Links are drawn as sticks; the ring is the base."
)
AROUND = (
    "Obstacles from robot.toml: {names}. A motion may pass in front of or behind an obstacle and seem to "
    "touch it; the distances are in the trajectory's certificate."
)
NOTHING = "robot.toml names no floor, box or wall, so none is drawn, and motions avoid none."
TOO_FAR = "Too far away to be drawn: {names}."


def motion(record: Record) -> Html:
    """In space, and as a drawing for paper and for browsers that cannot; nothing for what cannot be drawn."""
    numbers = [n for n, r in sorted(record.state.rounds.items()) if r.asked is not None]
    trajectory = record.trajectory(numbers[-1]) if numbers else None
    if trajectory is None:
        return Html("")
    path = trajectory.motion(np.linspace(0.0, trajectory.duration, FRAMES), 1).orders[0]
    if path.shape[1] != len(record.names):
        return Html("")
    try:
        figure, space = figure_along(record, path), in_space(record, numbers[-1])
    except EtudeError as error:
        return section("motion", TITLE, missing_data(f"The robot cannot be drawn: {error}"))
    parts = [describe_motion(space), figure_in_space(space, record)] if space is not None else []
    parts += [sticks_alone(f"Trajectory {numbers[-1]}", figure)] if figure is not None else []
    return section("motion", TITLE, *parts) if parts else Html("")


def sticks_alone(title: str, figure: Figure) -> Html:
    """The drawing with its captions, for pages that show nothing in space."""
    tips = "its tip" if len(figure.tips) == 1 else "its tips"
    captions = paragraph(TEXT.format(tips=tips)), paragraph(_of_things(figure))
    return element("div", *captions, stage(title, figure), class_="sticks")


CARRIED = {"tool": "c3", "payload": "c4"}


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
    visible = [name for name in around if name not in far] + carried
    sentences = [AROUND.format(names=", ".join(visible))] if visible else []
    sentences += [NOTHING] if not around else []
    return " ".join([*sentences, *([TOO_FAR.format(names=", ".join(far))] if far else [])])


def stage(title: str, figure: Figure) -> Html:
    """The figure in poses on its way, the first in front, among what stands around it."""
    room = room_around(figure)
    camera, height = camera_of(room, SIZE)
    things = fixed_objects(camera, room, figure.things)
    ghosts = np.linspace(0, len(figure.points) - 1, GHOSTS + 2).round().astype(int)[1:-1]
    parts = [drawn_room(camera, room), things]
    parts += [_pose(camera, figure, k, "ghost") for k in ghosts.tolist()]
    parts += [_tip_path(camera, figure.points[:, tip], room.lower[2]) for tip in figure.tips]
    x, y = camera(figure.points[0, :1])[0]
    parts.append(f'<circle class="start" cx="{x:.1f}" cy="{y:.1f}" r="5"><title>base</title></circle>')
    carried = [thing for thing in figure.things if thing.kind == "carried"]
    moving = _pose(camera, figure, 0, "limb c1") + "".join(carried_pose(camera, one, 0) for one in carried)
    parts.append(f'<g class="robot">{moving}</g>')
    name = f'<text class="title" x="12" y="18">{text(title)}</text>{legend(figure, 38.0)}'
    box = f'viewBox="0 0 {SIZE[0]} {height:.0f}" role="img" aria-label="{text(title)}, as a figure of sticks"'
    return element("figure", Html(f'<svg class="scene" {box}>{name}{"".join(parts)}</svg>'), class_="stage")


def _tip_path(camera: Camera, points: Array, floor: float) -> str:
    """The path (T, 3) of a tip, and its shadow."""
    ground = np.column_stack([points[:, :2], np.full(len(points), floor)])
    shadow = f'<path class="shadow" d="{polyline(*camera(ground).T)}"/>'
    return f'{shadow}<path class="trail c2" d="{polyline(*camera(points).T)}"/>'


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
