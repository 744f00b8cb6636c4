"""Cost and gain of each round, the confirmation on the robot, and the origin of all figures."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib import metadata
from typing import Any

from etude.campaign.record.events import Created
from etude.campaign.record.state import Round
from etude.report.markup import (
    FEEDBACK,
    Html,
    duration,
    element,
    join,
    missing_data,
    number,
    paragraph,
    section,
    table,
    with_unit,
)
from etude.report.record import Evaluation, Record, Test, chosen_structure, structure_name, tests

COSTS = ("round", "robot time", "robot time so far")
GAINS = ("error before", "error after", "change", "gained per robot minute")


def rounds(record: Record) -> Html:
    """One row per round; without a simulated test only its cost and the model chosen."""
    title = "Cost and benefit of each round"
    if not record.state.rounds:
        return section("rounds", title, missing_data("There is no round yet."))
    test = next((test for test in tests(record) if test.learned), None)
    rows = _rows(record, test)
    header = [*COSTS, *(GAINS if test else ()), "model in use"]
    text = paragraph(
        "Error is the mean tracking error on the first test above; the first round is compared with the "
        "robot's own feedback alone."
        if test
        else "This robot has no simulated test; the learning curve above shows the benefit of each log."
    )
    return section("rounds", title, text, table(header, rows))


def _rows(record: Record, test: Test | None) -> list[list[str]]:
    errors = {e.number: e for e in test.learned} if test else {}
    before = errors.get(0) or _feedback(test)
    rows, spent = [], 0.0
    for entry in _in_order(record):
        cost = _seconds(entry, spent)
        spent += cost
        after = errors.get(entry.number)
        costs = [f"{entry.number}", duration(cost) if entry.ingested else "–", duration(spent)]
        gains = _gains(before, after, cost) if test else []
        structure = chosen_structure(entry.trained)
        rows.append([*costs, *gains, structure_name(structure) if structure else _state(entry)])
        before = after or before
    return rows


def _feedback(test: Test | None) -> Evaluation | None:
    """What the robot's own feedback does alone."""
    evaluations = (test.baseline(name) for name in FEEDBACK) if test else iter(())
    return next((evaluation for evaluation in evaluations if evaluation), None)


def _in_order(record: Record) -> list[Round]:
    """Learned rounds in the order of learning, which is that of their robot time; then the others."""
    learned = record.state.trained
    return learned + [r for _, r in sorted(record.state.rounds.items()) if r.trained is None]


def _seconds(entry: Round, spent: float) -> float:
    """Robot time of one round: as told, else from the running total."""
    if entry.ingested:
        return entry.ingested.robot_seconds
    return max(0.0, entry.trained.robot_seconds - spent) if entry.trained else 0.0


def _gains(before: Evaluation | None, after: Evaluation | None, cost: float) -> list[str]:
    if after is None:
        return [before.text if before else "–", "–", "–", "–"]
    if before is None:
        return ["–", after.text, "–", "–"]
    gain = before.mean - after.mean
    share = f"{'−' if gain >= 0 else '+'}{number(abs(100 * gain / before.mean), 2)} %"
    rate = with_unit(60 * gain / cost, after.unit, 2) if cost > 0 else "–"
    return [before.text, after.text, share, rate]


def _state(entry: Round) -> str:
    if entry.abandoned and not entry.ingested:
        return "abandoned"
    if entry.confirms:
        return "confirms, never learned"
    if entry.weighs:
        return "payload motion, never used for training"
    if entry.learned:
        return "learned" if entry.learned_with is None else f"learned with {entry.learned_with}"
    if entry.untold:
        return "log taken back"
    if entry.excluded:
        return "set aside"
    if entry.awaits_answer:
        return "waits: has the robot changed?"
    return "ingested, not learned yet" if entry.ingested else "waiting for its log"


TITLE = "Proof on the robot: without and with the feedforward"


def confirmation(record: Record) -> Html:
    """A table for each motion that confirms; nothing where none was run."""
    from etude.campaign.record.confirmation import confirmed

    if record.campaign is None:
        return Html("")
    confirmations = [confirmed(record.campaign, one) for one in record.state.confirmations]
    complete = [one for one in confirmations if one["units"] is not None]
    if not complete:
        return Html("")
    text = paragraph(
        "Mean absolute tracking errors on a motion that is never used for training, under the robot's "
        "own feedback alone and with the commands of the model in use. The forecast is for moving axes: "
        "the error without the feedforward times the unknown part of the command when the motion was "
        "planned, plus the encoder's noise and at most a lag of all axes. There is no forecast for axes "
        "at rest, because friction holds them."
    )
    return section("confirmation", TITLE, text, *(_table(one) for one in complete))


def _table(one: Mapping[str, Any]) -> Html:
    from etude.campaign.record.confirmation import SHOWN

    columns = [one[key] or [None] * len(one["axes"]) for key in SHOWN]
    rows = [
        [axis, *(_figure(value) for value in values), unit]
        for axis, unit, *values in zip(one["axes"], one["units"], *columns, strict=True)
    ]
    return Html(paragraph(f"Trajectory {one['number']}.") + table(("axis", *SHOWN.values(), "unit"), rows))


def _figure(value: float | tuple[float, float] | None) -> str:
    if isinstance(value, tuple):
        return f"{number(value[0], 2)} .. {number(value[1], 2)}"
    return number(value)


def repairs(record: Record) -> Html:
    """What was changed in each log while reading it; nothing is repaired in silence."""
    title = "Repairs made on the logs"
    ingested = record.state.ingested
    if not ingested:
        return section("repairs", title, missing_data("No log was ingested yet."))
    rows = [[f"{r.number}", sentence] for r in ingested if r.ingested for sentence in r.ingested.repairs]
    if not rows:
        return section("repairs", title, paragraph(f"None: {len(ingested)} logs were used without repairs."))
    return section("repairs", title, table(["log", "repair"], rows))


def provenance(record: Record) -> Html:
    """Configuration hash, seed, versions, and what could not be read."""
    parts: list[Html] = [table(["what", "value"], _facts(record))]
    if record.notes:
        items = join(element("li", note) for note in record.notes)
        parts.append(paragraph("Some files in the folder could not be read:") + element("ul", items))  # type: ignore[arg-type]
    return section("provenance", "Provenance", *parts, _config(record))


def _facts(record: Record) -> list[list[object]]:
    created = next(((e, e.fact) for e in record.events if isinstance(e.fact, Created)), None)
    last = record.events[-1] if record.events else None
    rows: list[list[object]] = [["robot", record.robot if record.campaign else "unknown"]]
    if created:
        event, fact = created
        rows += [["created", event.time], ["seed", _code(fact.seed)], ["preset", _code(fact.preset)]]
    if last:
        rows += [
            ["last event", f"{last.event}, {last.time}"],
            ["configuration then (sha256)", _code(last.config_sha256)],
        ]
    rows.append(["events in the journal", f"{len(record.events)}"])
    rows += [["report drawn with", f"etude {_version('etude')}, Python {platform.python_version()}"]]
    return rows


def _code(value: Any) -> Html:
    return element("code", value)


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "of unknown version"


def _config(record: Record) -> Html:
    path = record.folder / "campaign.toml"
    if not path.is_file():
        return missing_data("campaign.toml is missing.")
    content = path.read_text(encoding="utf-8", errors="replace")
    return element("details", element("summary", "campaign.toml"), element("pre", element("code", content)))
