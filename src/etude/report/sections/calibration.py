"""Whether the model's own uncertainty can be trusted: z² and 95 % coverage on held-out data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.report.curves import chosen_kind, kind_name, score, scored_kinds
from etude.report.markup import Html, element, grid, missing, paragraph, section, table
from etude.report.record import Facts, Record
from etude.report.scales import Axis
from etude.report.sections.learning import joint_style
from etude.report.svg import Band, Level, Line, Mark, panel

Array = NDArray[np.float64]

Z2_BAND = (0.5, 2.5)
COVERAGE_TARGET = 0.85


def calibration(record: Record) -> Html:
    """z² and coverage of the model in use after each round, per joint, with the band that is good enough."""
    title = "Held-out calibration"
    if not any(_in_use(r.trained, "z2") is not None for r in record.state.trained):
        return section("calibration", title, missing("No held-out score yet: it comes with the second log."))
    text = paragraph(
        "The model in use predicts each new log before it learns from it. z² is the mean squared "
        "error over the predicted variance: 1 is honest, more is too sure of itself, less too "
        "cautious. Coverage is the share of the commands inside the predicted 95 % interval. The "
        "bands show what is good enough."
    )
    return section("calibration", title, text, paragraph(_verdict(record)), grid(_panels(record)))


def _panels(record: Record) -> list[Html]:
    z2, cover = (_lines(record, quantity) for quantity in ("z2", "coverage"))
    highest = 1.5 * np.nanmax([10.0 / 1.5, *(value for line in z2 for value in line.y)])
    lowest = np.nanmin([0.5, *(value for line in cover for value in line.y)])
    rounds = Axis("round", limits=(0.5, len(record.state.trained) + 0.5))
    target: Mark = Band(*Z2_BAND, "target")
    good: Mark = Band(COVERAGE_TARGET, 1.0, "target")
    z2_axis = Axis("z² (1)", log=True, limits=(0.1, float(highest)))
    cover_axis = Axis("coverage (1)", limits=(float(lowest), 1.0))
    ideal, nominal = Level(1.0, "honest", style="limit"), Level(0.95, "nominal", style="limit")
    return [
        panel("z² on held-out data", rounds, z2_axis, [target, ideal, *z2]),
        panel("Coverage of the 95 % interval", rounds, cover_axis, [good, nominal, *cover]),
    ]


def _in_use(trained: Facts | None, quantity: str) -> Array | None:
    """The score of the model in use when the log came, or of the nearest kind that has one."""
    facts = trained or {}
    kinds = [*(facts.get("models") or {}), facts.get("chosen"), facts.get("predicted_by")]
    scores = (score(trained, kind, quantity) for kind in reversed(kinds) if kind)
    return next((found for found in scores if found is not None), None)


def _lines(record: Record, quantity: str) -> list[Line]:
    scored = [
        (index, values)
        for index, r in enumerate(record.state.trained, start=1)
        if (values := _in_use(r.trained, quantity)) is not None
    ]
    x = np.array([index for index, _ in scored], dtype=float)
    columns = np.array([values for _, values in scored]).T
    return [
        Line(x, column, name, joint_style(j), markers=True)
        for j, (column, name) in enumerate(zip(columns, _names(record, len(columns)), strict=True))
    ]


def _names(record: Record, count: int) -> tuple[str, ...]:
    named = record.names
    return named if len(named) == count else tuple(f"joint {j + 1}" for j in range(count))


def _verdict(record: Record) -> str:
    last = record.state.trained[-1].trained
    z2, cover = _in_use(last, "z2"), _in_use(last, "coverage")
    if z2 is None or cover is None:
        return "The newest model has no held-out score."
    names = _names(record, len(z2))
    outside = [
        name
        for name, v, c in zip(names, z2, cover, strict=False)
        if not (Z2_BAND[0] <= v <= Z2_BAND[1] and c >= COVERAGE_TARGET)
    ]
    if not outside:
        return (
            "On the newest held-out data every joint is inside both bands: the deviations can be relied on."
        )
    listed = ", ".join(outside)
    return f"On the newest held-out data outside a band: {listed}. Take the deviations there with care."


def ladder(record: Record) -> Html:
    """Scores of every rung of the model ladder on the newest held-out data, the chosen one in bold."""
    title = "Model ladder"
    scored = [r for r in record.state.trained if r.trained and r.trained.get("models")]
    if not scored:
        return section("ladder", title, missing("No model has been scored yet."))
    last = scored[-1]
    chosen = chosen_kind(last.trained)
    kinds = [kind for kind in scored_kinds(record) if score(last.trained, kind, "nmse") is not None]
    rows = [_rung(last.trained, kind) for kind in kinds]
    names = list(record.names)
    header = ["model", "nMSE, mean", *(f"nMSE {name}" for name in names), "z², mean", "coverage, mean"]
    text = paragraph(
        f"Scored on log {last.number} before it was learned. nMSE is the mean squared error over the "
        "variance of the command; lower is better; GP is the Gaussian process. In use now: ",
        element("b", kind_name(chosen)),
        ".",
    )
    return section(
        "ladder", title, text, table(header, rows, kinds.index(chosen) if chosen in kinds else None)
    )


def _rung(trained: Facts | None, kind: str) -> list[object]:
    def mean(quantity: str) -> float:
        values = score(trained, kind, quantity)
        return float("nan") if values is None else float(np.nanmean(values))

    nmse = score(trained, kind, "nmse")
    return [
        kind_name(kind),
        mean("nmse"),
        *(map(float, nmse) if nmse is not None else ()),
        mean("z2"),
        mean("coverage"),
    ]
