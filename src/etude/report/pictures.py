"""Pictures of single objects for notebooks, a README or a slide, from the report's own panels.

Draw a campaign's learning curves with `python -m etude.report.pictures CAMPAIGN_FOLDER OUT.svg`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from etude.campaign.record.folder import Campaign
from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.report.markup import Html
from etude.report.record import Record, Test, read_record, score, tests
from etude.report.scales import Axis, Scale
from etude.report.sections.learning import joint_style, learning_panel
from etude.report.svg import Line, Mark, panel, thinned
from etude.storage import write_atomic
from etude.types import Array, Channel, Finding, Log

SIZE = (560, 320)  # px
NAMESPACE = 'xmlns="http://www.w3.org/2000/svg"'
INSTANTS = 400  # of a curve: more than a screen shows


def standalone_svg(panels: Sequence[Html]) -> Html:
    """A standalone SVG with these panels side by side, in light or dark colours as the reader's system."""
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
    """States and commands of a log over time, one panel for each channel."""
    shown = [name for name, c in log.channels.items() if c.role in ("state", "command") and name in log]
    return standalone_svg([_channel(log, name) for name in shown])


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
    return standalone_svg(panels)


def of_campaign(campaign: Campaign) -> Html:
    """The learning curve: test errors of a simulated robot, or nMSE of each log before it was learned."""
    record = read_record(campaign.path)
    drawn = [learning_panel(test) for test in tests(record) if test.learned][:2]
    return standalone_svg(drawn or [_held_out(record)])


def _held_out(record: Record) -> Html:
    logs = [(r.number, r.trained) for r in record.state.trained if r.trained]
    scores = {number: score(trained, trained.predicted_by, "nmse") for number, trained in logs}
    scored = {number: values for number, values in scores.items() if values is not None}
    marks: list[Mark] = [
        Line(np.array(list(scored), dtype=float), np.array(column), name, joint_style(j), markers=True)
        for j, (name, column) in enumerate(
            zip(record.outputs, zip(*scored.values(), strict=True), strict=False)
        )
    ]
    count = max([1, *(number for number, _ in logs)])
    title = "Each log, predicted before training on it" if scored else "No log has been predicted yet"
    axes = Axis("log", limits=(0.5, count + 0.5), whole=True), Axis("nMSE (1)", log=bool(scored))
    return panel(title, *axes, marks, size=SIZE)


POINTS = 600  # of a line, about one for each px
THINNEST = 1.5
"""px: a span is seen, however short."""


@dataclass(frozen=True)
class Span:
    """A time interval, marked over the whole height of a panel."""

    start: float
    end: float
    label: str = ""
    style: str = "area"

    def extent(self) -> tuple[Array, Array]:
        return np.array([self.start, self.end]), np.empty(0)

    def draw(self, x: Scale, y: Scale) -> str:
        left, right = (float(x(v)) for v in (self.start, self.end))
        top, height = min(y.start, y.end), abs(y.end - y.start)
        size = f'width="{max(right - left, THINNEST):.1f}" height="{height:.1f}"'
        return f'<rect class="{self.style}" x="{left:.1f}" y="{top:.1f}" {size}/>'

    def swatch(self, x: float, y: float) -> str:
        return f'<rect class="{self.style}" x="{x:.1f}" y="{y - 6:.1f}" width="22" height="12"/>'


def recording_picture(log: Log, findings: Sequence[Finding]) -> Html:
    """A standalone SVG with positions and commands; for robots without positions, every state and command."""
    spans = [span for f in findings if f.light in ("yellow", "red") for span in _spans(f)]
    return standalone_svg([_drawn(log, channel, spans) for channel in _main_channels(log)])


def _spans(finding: Finding) -> list[Span]:
    return [
        Span(start, end, "" if k else f"marked: {finding.check}")
        for k, (start, end) in enumerate(finding.spans)
    ]


def _main_channels(log: Log) -> list[Channel]:
    channels = [c for n, c in log.channels.items() if n in log]
    commands = [c for c in channels if c.role == "command"]
    paths = [log.channels[c.acts_on] for c in commands if c.acts_on in log]
    others = [c for c in channels if c.role == "state" and not c.derivative_of]
    return [*(paths or others), *commands] or channels[:6]


def _drawn(log: Log, channel: Channel, spans: Sequence[Span]) -> Html:
    marks: list[Mark] = [
        *spans,
        *(
            Line(*thinned(log.t, log[channel.name][:, j], POINTS), part, joint_style(j))
            for j, part in enumerate(channel.parts)
        ),
    ]
    limits = (float(log.t[0]), float(log.t[-1]))
    unit = ", ".join(dict.fromkeys(channel.units))
    return panel(
        channel.name, Axis("time (s)", limits=limits), Axis(f"{channel.name} ({unit})"), marks, size=SIZE
    )


def write_picture(folder: Path, path: Path) -> Path:
    """Writes the learning curves of a simulated campaign, side by side, to `path` (SVG), and returns the
    path.

    Raises:
        UsageError: the folder holds no campaign, or the campaign has no evaluation.
    """
    write_atomic(Path(path), learning_picture(read_record(Path(folder))).encode("utf-8"))
    return Path(path)


def learning_picture(record: Record) -> Html:
    """A standalone SVG with one panel for each test motion (two at most), in light or dark colours.

    Raises:
        UsageError: the campaign has no evaluation.
    """
    return standalone_svg([learning_panel(test) for test in learned_tests(record)][:2])


def learned_tests(record: Record) -> list[Test]:
    """The tests of a learned controller. UsageError: there are none."""
    learned = [test for test in tests(record) if test.learned]
    if not learned:
        raise UsageError(
            "this campaign has no evaluation to draw",
            where=str(record.folder),
            next_step="Only `etude simulate` and `etude demo` evaluate controllers.",
        )
    return learned


def main(arguments: list[str]) -> None:
    """Entry of `python -m etude.report.pictures`."""
    if len(arguments) != 2:
        raise UsageError(
            "two arguments are needed", next_step="Give the folder of the campaign and the path of the SVG."
        )
    write_picture(Path(arguments[0]), Path(arguments[1]))


if __name__ == "__main__":
    main(sys.argv[1:])
