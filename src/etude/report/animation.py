"""Animated picture of a campaign: the robot along each proposed motion, and its error after each log.

Draw it with `python -m etude.report.animation CAMPAIGN_FOLDER OUT.svg`. The animation is SMIL inside one SVG,
so that a README shows it without a script. Without animation, the picture shows the last log.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.report.markup import Html, error_axis, test_title, text
from etude.report.pictures import SIZE, learned_tests, standalone_svg
from etude.report.record import Record, Test, read_record
from etude.report.scales import Axis, fitted_scale
from etude.report.scene import Camera, camera_of, drawn_room, figure_along, fixed_objects, room_around
from etude.report.sections.learning import curve_marks
from etude.report.sections.motion import sticks
from etude.report.svg import panel
from etude.storage import write_atomic
from etude.types import Array, Figure

SECONDS, HOLD = 3.0, 3.0
"""s of the picture for each motion, and that the last state stands before all begins again."""
FRAMES = 48
"""Poses of a motion: 16 in a second, at which a motion looks smooth, in 70 kB for six motions."""


def of_campaign(record: Record) -> Html:
    """A standalone SVG: on the left the robot along its motions, on the right its mean error after each log.

    Raises:
        UsageError: the campaign has no motion or no evaluation, or its robot cannot be drawn.
    """
    curves = learned_tests(record)
    rounds = min(len(curves[0].learned), sum(r.asked is not None for r in record.state.rounds.values()))
    figures = [_figure(record, number) for number in range(1, rounds + 1)]
    total = SECONDS * rounds + HOLD
    return standalone_svg([_robot(figures, total), _curves(curves[0], rounds, total)])


def _figure(record: Record, number: int) -> tuple[Trajectory, Figure]:
    """A motion and the robot along it. UsageError: the motion is missing, or its robot cannot be drawn."""
    trajectory = record.trajectory(number)
    if trajectory is not None:
        path = trajectory.motion(np.linspace(0.0, trajectory.duration, FRAMES), 1).orders[0]
        if (figure := figure_along(record, path)) is not None:
            return trajectory, figure
    raise UsageError(
        "this robot cannot be drawn",
        where=f"motion {number} of {record.folder}",
        next_step="Name a model file in robot.toml (model_file), and simulate a campaign with it.",
    )


def _robot(motions: Sequence[tuple[Trajectory, Figure]], total: float) -> Html:
    """Sticks that follow each motion in turn, faster than real time; the title gives the factor."""
    every = np.concatenate([figure.points for _, figure in motions])
    room = room_around(replace(motions[0][1], points=every))
    camera, height = camera_of(room, SIZE)
    things = fixed_objects(camera, room, motions[0][1].things)
    drawn = [_moving(camera, [figure for _, figure in motions], total)]
    for k, (trajectory, _) in enumerate(motions):
        fast = trajectory.duration / SECONDS
        caption = f"Motion {k + 1} of {len(motions)}, at {fast:.0f} times its speed"
        drawn.append(
            _visible_during(f'<text class="title" x="12" y="18">{caption}</text>', k, len(motions), total)
        )
    name = text("The robot along its motions")
    return Html(
        f'<svg class="scene" viewBox="0 0 {SIZE[0]} {height:.0f}" role="img" aria-label="{name}">'
        f"{drawn_room(camera, room)}{things}{''.join(drawn)}</svg>"
    )


def _moving(camera: Camera, figures: Sequence[Figure], total: float) -> str:
    """One path of sticks through the poses of all motions; it holds its last pose until the animation
    restarts.
    """
    poses = [sticks(camera, figure, k) for figure in figures for k in range(len(figure.points))]
    times = [SECONDS * (m + k / (FRAMES - 1)) / total for m in range(len(figures)) for k in range(FRAMES)]
    values, keys = ";".join([*poses, poses[-1]]), ";".join(f"{time:.4f}" for time in [*times, 1.0])
    animate = _animate("d", values, keys, total)
    return f'<path class="limb c1" d="{poses[-1]}">{animate}</path>'


def _curves(test: Test, rounds: int, total: float) -> Html:
    """The learning curve up to each motion, on axes that fit all logs."""
    title = f"Mean tracking error on {test_title(test.name)}"
    whole = [mark.extent() for mark in curve_marks(test)]
    x, y = Axis("robot time (s)", floor=0.0), Axis(error_axis(test.unit), log=True)
    x, y = (
        _with_limits(axis, np.concatenate(part))
        for axis, part in zip((x, y), zip(*whole, strict=True), strict=True)
    )
    parts = []
    for logs in range(rounds + 1):
        every = test.baselines.items()
        baselines = {name: series[: max(1, logs)] for name, series in every if logs or len(series) == 1}
        upto = replace(test, learned=test.learned[:logs], baselines=baselines)
        drawn = panel(title, x, y, curve_marks(upto), end_labels=True)
        parts.append(_visible_during(drawn, logs, rounds + 1, total))
    return Html(f'<svg viewBox="0 0 {SIZE[0]} {SIZE[1]}">{"".join(parts)}</svg>')


def _with_limits(axis: Axis, values: Array) -> Axis:
    """The axis with the limits of all values."""
    scale = fitted_scale(axis, values, 0.0, 1.0)
    return replace(axis, limits=(scale.low, scale.high))


def _visible_during(drawing: str, k: int, count: int, total: float) -> str:
    """A drawing that is visible in the k-th part; the last one stays until the restart, and without
    animation.
    """
    last = k == count - 1
    states = [word for j in range(count) for word in (["visible"] if j == k else ["hidden"])]
    keys = ";".join(f"{SECONDS * j / total:.4f}" for j in range(count))
    animate = _animate("visibility", ";".join(states), keys, total, discrete=True)
    return f'<g visibility="{"visible" if last else "hidden"}">{animate}{drawing}</g>'


def _animate(attribute: str, values: str, keys: str, total: float, discrete: bool = False) -> str:
    mode = ' calcMode="discrete"' if discrete else ""
    return (
        f'<animate attributeName="{attribute}" dur="{total:g}s" repeatCount="indefinite"{mode} '
        f'keyTimes="{keys}" values="{values}"/>'
    )


def main(arguments: Sequence[str]) -> None:
    """Entry of `python -m etude.report.animation`."""
    if len(arguments) != 2:
        raise UsageError(
            "two arguments are needed", next_step="Give the folder of the campaign and the path of the SVG."
        )
    write_atomic(Path(arguments[1]), of_campaign(read_record(Path(arguments[0]))).encode("utf-8"))


if __name__ == "__main__":
    main(sys.argv[1:])
