"""What each round cost in robot time, and what it bought."""

from __future__ import annotations

from etude.campaign.record.state import Round
from etude.report.curves import Evaluation, Test, chosen_rung, rung_name, tests
from etude.report.markup import Html, duration, missing, number, paragraph, section, table, with_unit
from etude.report.record import Record
from etude.report.words import FEEDBACK

COSTS = ("round", "robot time", "robot time so far")
GAINS = ("error before", "error after", "change", "gained per robot minute")


def rounds(record: Record) -> Html:
    """One row per round; without a simulated test only its cost and the model chosen."""
    title = "What each round cost, and what it bought"
    if not record.state.rounds:
        return section("rounds", title, missing("No round has begun."))
    test = next((test for test in tests(record) if test.learned), None)
    rows = _rows(record, test)
    header = [*COSTS, *(GAINS if test else ()), "model in use"]
    text = paragraph(
        "Error is the mean tracking error on the first test above; the first round starts from the robot's "
        "own feedback alone."
        if test
        else "This robot has no simulated test; the learning curve above shows what each log was worth."
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
        costs = [f"{entry.number}", duration(cost) if entry.told else "–", duration(spent)]
        gains = _gains(before, after, cost) if test else []
        rung = chosen_rung(entry.trained)
        rows.append([*costs, *gains, rung_name(rung) if rung else _state(entry)])
        before = after or before
    return rows


def _feedback(test: Test | None) -> Evaluation | None:
    """What the robot's own feedback does alone."""
    found = (test.baseline(name) for name in FEEDBACK) if test else iter(())
    return next((evaluation for evaluation in found if evaluation), None)


def _in_order(record: Record) -> list[Round]:
    """Learned rounds in the order of learning, which is that of their robot time; then the others."""
    learned = record.state.trained
    return learned + [r for _, r in sorted(record.state.rounds.items()) if r.trained is None]


def _seconds(entry: Round, spent: float) -> float:
    """Robot time of one round: as told, else from the running total."""
    told, trained = entry.told or {}, entry.trained or {}
    if "robot_seconds" in told:
        return float(told["robot_seconds"])
    return max(0.0, float(trained.get("robot_seconds", spent)) - spent)


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
    if entry.abandoned and not entry.told:
        return "abandoned"
    if entry.confirms:
        return "confirms, never learned"
    if entry.learned:
        return "learned" if entry.learned_with is None else f"learned with {entry.learned_with}"
    if entry.untold:
        return "log taken back"
    if entry.aside:
        return "set aside"
    if entry.held:
        return "waits: has the robot changed?"
    return "told, not learned yet" if entry.told else "waiting for its log"
