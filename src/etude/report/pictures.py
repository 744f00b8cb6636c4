"""Pictures of single objects, for notebooks: the report's own panels, on their own."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

import numpy as np

from etude.campaign.record.folder import Campaign
from etude.protocols import Trajectory
from etude.report.curves import score, tests
from etude.report.markup import Html
from etude.report.record import Record, read_record
from etude.report.scales import Axis
from etude.report.sections.learning import joint_style, learning_panel
from etude.report.svg import Line, Mark, panel, thinned
from etude.types import Log

SIZE = (560, 320)
NAMESPACE = 'xmlns="http://www.w3.org/2000/svg"'
INSTANTS = 400


def alone(panels: Sequence[Html]) -> Html:
    """A standalone SVG with these panels side by side, light or dark as the reader's system is."""
    wide, high = SIZE
    width = wide * len(panels)
    drawn = "".join(
        drawing.replace("<svg ", f'<svg x="{wide * index}" width="{wide}" height="{high}" ', 1)
        for index, drawing in enumerate(panels)
    )
    style = resources.files("etude.report").joinpath("report.css").read_text(encoding="utf-8")
    paper = f'<rect width="{width}" height="{high}" style="fill:var(--paper)"/>'
    font = 'font-family="system-ui, sans-serif"'
    return Html(
        f'<svg {NAMESPACE} viewBox="0 0 {width} {high}" width="{width}" height="{high}" {font}>'
        f"<style>{style}</style>{paper}{drawn}</svg>\n"
    )


def of_log(log: Log) -> Html:
    """The states and the commands of a log over time, a panel for each channel."""
    shown = [name for name, c in log.channels.items() if c.role in ("state", "command") and name in log]
    return alone([_channel(log, name) for name in shown])


def _channel(log: Log, name: str) -> Html:
    channel = log.channels[name]
    marks: list[Mark] = [
        Line(*thinned(log.t, log[name][:, j], 400), part, joint_style(j))
        for j, part in enumerate(channel.parts)
    ]
    time = Axis("time (s)", limits=(float(log.t[0]), float(log.t[-1])))
    return panel(name, time, Axis(f"{name} ({', '.join(dict.fromkeys(channel.units))})"), marks, size=SIZE)


def of_trajectory(trajectory: Trajectory) -> Html:
    """Position, velocity and acceleration of every coordinate over time."""
    t = np.linspace(0.0, trajectory.duration, INSTANTS)
    orders = trajectory.motion(t, 3).orders
    names = ("position", "velocity", "acceleration")
    time = Axis("time (s)", limits=(0.0, trajectory.duration))
    panels = []
    for name, values in zip(names, orders, strict=True):
        marks: list[Mark] = [
            Line(t, column, f"axis {j + 1}", joint_style(j)) for j, column in enumerate(values.T)
        ]
        panels.append(panel(name, time, Axis(f"{name} (SI)"), marks, size=SIZE))
    return alone(panels)


def of_campaign(campaign: Campaign) -> Html:
    """The learning curve of a simulated robot; of a real one, held-out nMSE of what is in use, by log."""
    record = read_record(campaign.path)
    drawn = [learning_panel(test) for test in tests(record) if test.learned][:2]
    return alone(drawn or [_held_out(record)])


def _held_out(record: Record) -> Html:
    logs = [r for r in record.state.trained if r.trained]
    found = {r.number: score(r.trained, (r.trained or {}).get("predicted_by"), "nmse") for r in logs}
    known = {number: values for number, values in found.items() if values is not None}
    marks: list[Mark] = [
        Line(np.array(list(known), dtype=float), np.array(column), name, joint_style(j), markers=True)
        for j, (name, column) in enumerate(
            zip(record.outputs, zip(*known.values(), strict=True), strict=False)
        )
    ]
    count = max([1, *(r.number for r in logs)])
    title = "Each log, predicted before it was learned" if known else "No log has been predicted yet"
    axes = Axis("log", limits=(0.5, count + 0.5), whole=True), Axis("nMSE (1)", log=bool(known))
    return panel(title, *axes, marks, size=SIZE)
