"""Whether the model's own uncertainty can be trusted: z² and 95 % coverage on held-out data."""

from __future__ import annotations

import itertools

import numpy as np

from etude.report.curves import score
from etude.report.markup import Html, element, grid, missing, paragraph, section
from etude.report.record import Facts, Record
from etude.report.scales import Axis
from etude.report.sections.learning import joint_style
from etude.report.svg import Band, Level, Line, Mark, panel
from etude.types import Array

Z2 = (0.5, 2.5)
"""Band of z² that is good enough."""
COVERAGE = 0.85
"""Least coverage that is good enough."""
UNCALIBRATED = (
    "too few logs have been held out to say how wrong a new one will be, so the model in use is trusted by "
    "distance (only where inputs are near those it learned), not by its deviations."
)


def calibration(record: Record) -> Html:
    """z² and coverage of the model in use after each round, per output, with the band that is good enough."""
    title = "Held-out calibration"
    if not any(in_use(r.trained, "z2") is not None for r in record.state.trained):
        nothing = missing("No held-out score yet: it comes with the second log.")
        newest = _uncalibrated(record) if record.state.trained else []
        return section("calibration", title, *newest, nothing)
    text = paragraph(
        "The model in use predicts each new log before it learns from it. z² is the mean squared "
        "error over the predicted variance: 1 is honest, more is too sure of itself, less too "
        "cautious. Coverage is the share of the commands inside the predicted 95 % interval. The "
        "bands show what is good enough."
    )
    sentences = [text, *_uncalibrated(record), paragraph(_verdict(record)), *_early(record)]
    return section("calibration", title, *sentences, grid(_panels(record)))


def _uncalibrated(record: Record) -> list[Html]:
    """A model that says itself that too few logs were held out."""
    if (record.state.trained[-1].trained or {}).get("calibrated", True):
        return []
    return [paragraph(element("b", "Uncalibrated:"), f" {UNCALIBRATED}", class_="missing")]


def _panels(record: Record) -> list[Html]:
    z2, cover = (_lines(record, quantity) for quantity in ("z2", "coverage"))
    highest = 1.5 * np.nanmax([10.0 / 1.5, *(value for line in z2 for value in line.y)])
    lowest = np.nanmin([0.5, *(value for line in cover for value in line.y)])
    rounds = Axis("round", limits=(0.5, len(record.state.trained) + 0.5), whole=True)
    target: Mark = Band(*Z2, "target")
    good: Mark = Band(COVERAGE, 1.0, "target")
    z2_axis = Axis("z² (1)", log=True, limits=(0.1, float(highest)))
    cover_axis = Axis("coverage (1)", limits=(float(lowest), 1.0))
    ideal, nominal = Level(1.0, "honest", style="limit"), Level(0.95, "nominal", style="limit")
    return [
        panel("z² on held-out data", rounds, z2_axis, [target, ideal, *z2]),
        panel("Coverage of the 95 % interval", rounds, cover_axis, [good, nominal, *cover]),
    ]


def _early(record: Record) -> list[Html]:
    """Which of the scores are those of models that did not claim to be calibrated."""
    pairs = itertools.pairwise(record.state.trained)
    early = [now.number for before, now in pairs if not (before.trained or {}).get("calibrated", True)]
    if not early:
        return []
    logs = f"log {early[0]}" if len(early) == 1 else f"logs {', '.join(map(str, early))}"
    return [paragraph(f"The models that predicted {logs} were not calibrated yet.", class_="soft")]


def in_use(trained: Facts | None, quantity: str) -> Array | None:
    """The score of the model in use when the log came, or of the nearest rung that has one."""
    facts = trained or {}
    rungs = [*(facts.get("models") or {}), facts.get("chosen"), facts.get("predicted_by")]
    scores = (score(trained, rung, quantity) for rung in reversed(rungs) if rung)
    return next((found for found in scores if found is not None), None)


def _lines(record: Record, quantity: str) -> list[Line]:
    scored = [
        (index, values)
        for index, r in enumerate(record.state.trained, start=1)
        if (values := in_use(r.trained, quantity)) is not None
    ]
    x = np.array([index for index, _ in scored], dtype=float)
    columns = np.array([values for _, values in scored]).T
    return [
        Line(x, column, name, joint_style(j), markers=True)
        for j, (column, name) in enumerate(zip(columns, _names(record, len(columns)), strict=True))
    ]


def _names(record: Record, count: int) -> tuple[str, ...]:
    named = record.outputs
    return named if len(named) == count else tuple(f"command {j + 1}" for j in range(count))


def _verdict(record: Record) -> str:
    last = record.state.trained[-1].trained
    z2, cover = in_use(last, "z2"), in_use(last, "coverage")
    if z2 is None or cover is None:
        return "The newest model has no held-out score."
    names, (least, most) = _names(record, len(z2)), Z2
    outside = [
        name
        for name, v, c in zip(names, z2, cover, strict=False)
        if not (least <= v <= most and c >= COVERAGE)
    ]
    if not outside:
        return (
            "On the newest held-out data every command is inside both bands: the deviations can be relied on."
        )
    listed = ", ".join(outside)
    return f"On the newest held-out data outside a band: {listed}. Take the deviations there with care."
