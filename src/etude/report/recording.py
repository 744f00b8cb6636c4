"""A log as a picture: positions and commands over time, with the spans that its findings mark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.report.markup import Html
from etude.report.pictures import SIZE, alone
from etude.report.scales import Axis, Scale
from etude.report.sections.learning import joint_style
from etude.report.svg import Line, Mark, panel, thinned
from etude.types import Array, Channel, Finding, Log

POINTS = 600
THINNEST = 1.5
"""px: a span is seen, however short."""


@dataclass(frozen=True)
class Span:
    """A stretch of time, marked over the whole height of a panel."""

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
    """A standalone SVG: positions and commands, or of other robots every state and command."""
    spans = [span for f in findings if f.light in ("yellow", "red") for span in _spans(f)]
    return alone([_drawn(log, channel, spans) for channel in _shown(log)])


def _spans(finding: Finding) -> list[Span]:
    return [
        Span(start, end, "" if k else f"marked: {finding.check}")
        for k, (start, end) in enumerate(finding.spans)
    ]


def _shown(log: Log) -> list[Channel]:
    known = [c for n, c in log.channels.items() if n in log]
    commands = [c for c in known if c.role == "command"]
    paths = [log.channels[c.acts_on] for c in commands if c.acts_on in log]
    others = [c for c in known if c.role == "state" and not c.derivative_of]
    return [*(paths or others), *commands] or known[:6]


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
