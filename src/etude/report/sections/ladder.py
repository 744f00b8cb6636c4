"""Scores of every model on logs that it had not learned, and which one is in use."""

from __future__ import annotations

import numpy as np

from etude.campaign.record.state import Round
from etude.report.curves import chosen_rung, rung_name, score, scored_rungs
from etude.report.markup import Html, element, grid, missing, paragraph, section, table
from etude.report.record import Facts, Record
from etude.report.scales import Axis
from etude.report.sections.calibration import in_use
from etude.report.sections.learning import joint_style
from etude.report.svg import Line, Mark, Points, panel
from etude.types import Array

Series = dict[str, dict[int, Array | None]]
"""By rung of model and number of the log."""


def ladder(record: Record) -> Html:
    """Scores of every rung of the model ladder on the newest held-out data, the chosen one in bold."""
    title = "Model ladder"
    scored = [r for r in record.state.trained if r.trained and r.trained.get("models")]
    if not scored:
        return section("ladder", title, missing("No model has been scored yet."))
    return section("ladder", title, *_newest(record, scored[-1]), *_by_round(record))


def _newest(record: Record, last: Round) -> list[Html]:
    chosen = chosen_rung(last.trained)
    rungs = [rung for rung in scored_rungs(record) if score(last.trained, rung, "nmse") is not None]
    rows = [[rung_name(rung), *_rung(last.trained, rung)] for rung in rungs]
    names = (f"nMSE {name}" for name in record.outputs)
    header = ["model", "nMSE, mean", *names, "nMSE with standing joints, mean", "z², mean", "coverage, mean"]
    text = paragraph(
        f"Scored on log {last.number} before it was learned. nMSE is the mean squared error over the "
        "variance of the command where its joint moves, beside it where any joint does; lower is better; GP "
        "is the Gaussian process. In use now: ",
        element("b", rung_name(chosen)),
        ".",
    )
    return [text, table(header, rows, rungs.index(chosen) if chosen in rungs else None)]


def _by_round(record: Record) -> list[Html]:
    """Every rung of model over the rounds; rings are around the rungs in use."""
    text = paragraph(
        "On the left every model on each new log before learning it; the ring is around the one in use when "
        "the log came. On the right every model's error on told logs, each left out in turn: from two "
        "logs on the least chooses the one in use, in the ring; before, physics alone compete."
    )
    rounds, unit = record.state.trained, record.unit or "1"
    seen = {rung: {r.number: score(r.trained, rung, "nmse") for r in rounds} for rung in scored_rungs(record)}
    used = {r.number: in_use(r.trained, "nmse") for r in rounds}
    left = {rung: {r.number: left_out(r.trained).get(rung) for r in rounds} for rung in seen}
    chosen = {r.number: left_out(r.trained).get(chosen_rung(r.trained) or "") for r in rounds}
    panels = [
        _rungs(record, "On each new log", "nMSE, mean over commands (1)", seen, used),
        _rungs(record, "On told logs left out", f"mean error ({unit})", left, chosen),
    ]
    return [text, grid(panels)]


def left_out(trained: Facts | None) -> dict[str, Array]:
    """(1,) mean absolute error of each rung on logs left out, command units."""
    errors = (trained or {}).get("held_out_mae") or {}
    return {rung: np.array([float(e)]) for rung, e in errors.items() if e is not None and np.isfinite(e)}


def _rungs(record: Record, title: str, axis: str, values: Series, ringed: dict[int, Array | None]) -> Html:
    marks: list[Mark] = []
    for index, (rung, scores) in enumerate(values.items()):
        x, y = _means(scores)
        style = "c7 dash" if rung == "linear" else joint_style(index)
        marks += [Line(x, y, rung_name(rung), style, markers=True)] if len(x) else []
    marks.append(Points(*_means(ringed), label="in use", style="ring", radius=8.0))
    logs = Axis("log", limits=(0.5, max(r.number for r in record.state.trained) + 0.5), whole=True)
    return panel(title, logs, Axis(axis, log=True), marks)


def _means(scores: dict[int, Array | None]) -> tuple[Array, Array]:
    """Numbers of the logs with a score, and its mean over the outputs."""
    found = {number: float(np.nanmean(values)) for number, values in scores.items() if values is not None}
    return np.array(list(found), dtype=float), np.array(list(found.values()))


def _rung(trained: Facts | None, rung: str) -> list[object]:
    def mean(quantity: str) -> float:
        values = score(trained, rung, quantity)
        return float("nan") if values is None else float(np.nanmean(values))

    nmse = score(trained, rung, "nmse")
    return [
        mean("nmse"),
        *(map(float, nmse) if nmse is not None else ()),
        mean("nmse_all"),
        mean("z2"),
        mean("coverage"),
    ]
