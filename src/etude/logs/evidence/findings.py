"""A decision in words: findings of `tell` and `inspect`, with the answers that each of them takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from etude.logs.checks.exact import CERTAIN, LIKELY
from etude.logs.checks.finding_texts import Doubt, Mendable, accepted, both, named
from etude.logs.checks.plausibility import DELAY, SIGN, SWAPPED
from etude.logs.checks.velocities import DIRECTION
from etude.logs.evidence.command_signs import GRAVITY
from etude.logs.evidence.delays import LEAST_DELAY
from etude.logs.evidence.joint_evidence import Decision
from etude.types import Finding, Log

COMMANDS = "commands"
MOST = 1000.0  # log odds that are written out


def finding_of(
    decision: Decision, parts: Sequence[str], sources: Sequence[str], old: Sequence[Log] = ()
) -> Finding:
    """The finding of a decision that is not silent.

    Args:
        parts: names of the joints.
        sources: names of the logs that were judged, the oldest first.
        old: those of them that were learned before; no repair changes them now.
    """
    where = _where(decision, sources)
    if decision.positions >= LIKELY:
        return _position_finding(decision, parts, where)
    if decision.check == SIGN:
        finding = _sign_finding(decision, parts, where)
    elif decision.check == SWAPPED:
        finding = _order_finding(decision, parts, where)
    elif decision.check == DIRECTION:
        finding = _direction_finding(decision, where)
    elif decision.check == DELAY:
        return _delay_finding(decision, parts, where)
    else:
        return _gravity_finding(decision)
    learned = [_log_description(sources[i], old[i]) for i in decision.logs if i < len(old)]
    return _without_partial_repair(finding, learned) if learned and isinstance(finding, Mendable) else finding


def green(decision: Decision, parts: Sequence[str]) -> list[Finding]:
    """The findings of a silent decision on delay, order and signs."""
    if not decision.moving.any():
        fact = "Too little motion to determine the order, the signs or the delay of the commands."
        return [Finding(COMMANDS, "cannot tell", fact)]
    is_known = np.asarray(decision.sign_odds >= LIKELY)
    unsure = named(parts, ~is_known)
    if not is_known.any():
        fact = "Neither sign of any command explains the motion better."
        signs = Finding(
            SIGN, "cannot tell", fact, "A longer motion, or a model file with masses, shows more."
        )
    else:
        remark = f" The sign of {unsure} cannot be determined." if unsure else ""
        signs = Finding(
            SIGN, "green", f"The sign of the commands of {named(parts, is_known)} is right.{remark}"
        )
    step = f"The commands are synchronous with the motion to {1e3 * LEAST_DELAY:.0f} ms."
    delay = Finding(DELAY, "green", step)
    if decision.why == "late":
        fact = "The delay of the commands cannot be determined: another delay fits as well."
        delay = Finding(DELAY, "cannot tell", fact, "Record commands and motion with one clock.")
    return [delay, *_order_findings(decision, parts), signs]


def _order_findings(decision: Decision, parts: Sequence[str]) -> list[Finding]:
    """The finding on the order."""
    if decision.moving.sum() < 2:
        return []
    if not decision.exchangeable:
        return [Finding(SWAPPED, "green", "No other order of the commands fits better.")]
    names = named(parts, np.isin(np.arange(len(parts)), decision.exchangeable))
    fact = f"The order of the commands of {names} cannot be determined."
    step = f"A model file with masses, or a log with more reversals of {names}, shows more."
    return [Finding(SWAPPED, "cannot tell", fact, step)]


def _where(decision: Decision, sources: Sequence[str]) -> str:
    """ " in all 3 logs", " in b.csv alone"; "" of a single log."""
    if len(sources) == 1:
        return ""
    if len(decision.logs) == len(sources):
        return f" in all {len(sources)} logs"
    return f" only in {', '.join(sources[i] for i in decision.logs)}"


def _light(decision: Decision) -> Literal["red", "yellow"]:
    return "red" if decision.level == "certain" else "yellow"


def _odds(decision: Decision) -> str:
    """ "log odds 40; 8 against the next best"."""
    next_ = f"; {_rounded(decision.ahead)} against the next best" if np.isfinite(decision.ahead) else ""
    return f"log odds {_rounded(decision.odds)}{next_}"


def _rounded(odds: float) -> str:
    return f"{odds:.0f}" if odds < MOST else f"above {MOST:.0f}"


def _sure(decision: Decision) -> str:
    return "" if decision.level == "certain" else "very probably "


def _sign_finding(decision: Decision, parts: Sequence[str], where: str) -> Finding:
    turned = np.array(decision.by) < 0.0
    names = named(parts, turned)
    if decision.why == "weight":
        fact = (
            f"The commands of {names}{where} contain the gravity of the model file with the opposite sign: "
            "very probably their sign is inverted."
        )
    elif decision.why == "order":
        odds = f"log odds {_rounded(decision.odds)}"
        fact = (
            f"The commands of {names}{where} do not fit their joints ({odds}): their signs are inverted, or "
        )
        fact += "their columns are exchanged."
    else:
        fact = f"The sign of the commands of {names} is {_sure(decision)}inverted{where} ({_odds(decision)})."
    fact += _position_note(decision, names)
    strange = np.asarray(decision.strange & decision.moving)
    if strange.any():
        fact += f" Neither sign explains the commands of {named(parts, strange)}."
    if not decision.clear:
        fact += f" {OTHERS[decision.why]}"
        step = f"{_deciding_step(decision, parts)}; {accepted(SIGN)}."
        return Doubt(SIGN, "yellow", fact, step, SIGN, by=decision.by)
    if decision.either_side:
        return Doubt(SIGN, _light(decision), f"{fact} {EITHER}", _side_step(SIGN), SIGN, by=decision.by)
    step = both(SIGN, f"invert the sign of {names}{where}")
    more = "" if decision.level == "certain" else f" {_deciding_step(decision, parts)}."
    return Mendable(SIGN, _light(decision), fact, step + more, flag=SIGN, by=decision.by)


def _position_finding(decision: Decision, parts: Sequence[str], where: str) -> Finding:
    """The finding that positions are wrong, by the model file's weights on the other joints."""
    by = np.array(decision.by)
    wrong = np.asarray(by < 0.0 if decision.check == SIGN else by != np.arange(len(by)))
    what = "have the wrong sign" if decision.check == SIGN else "are exchanged"
    fact = (
        f"The positions of {named(parts, wrong)} {what}{where}, not their commands, according to the "
        "model file"
    )
    step = f"Correct the columns of the positions, or the signs of the encoders; {accepted(decision.check)}."
    return Doubt(
        decision.check,
        "yellow",
        f"{fact} ({_odds(decision)}).",
        step,
        flag=decision.check,
        by=decision.by,
    )


def _position_note(decision: Decision, names: str) -> str:
    """The note that an error of the positions looks the same, unless a model file decides."""
    if decision.positions <= -CERTAIN:
        return ""
    return f" Wrong positions of {names} would look the same."


EITHER = "Neither the data nor the model file show which, so nothing is repaired."


def _side_step(check: str) -> str:
    """The next step where positions or commands are wrong: the robot shows which."""
    return f"Check at the robot which of them are wrong, and correct their columns; {accepted(check)}."


OTHERS = {
    "": "Other signs are nearly as likely, so none is repaired.",
    "time": "Rows that run backwards in time would look the same, so none is repaired.",
    "order": "The data do not show which, so nothing is repaired.",
    "weight": "Masses or the mounting may be wrong in the model file instead, so none is repaired.",
}
"""Why a sign is not repaired, by `Decision.why`."""


def _deciding_step(decision: Decision, parts: Sequence[str]) -> str:
    """The next step that decides; a model file is named only where none was used."""
    if decision.why == "time":
        other = "" if decision.positions else ", or a model file with masses,"
        return f"A log with velocities{other} decides"
    if decision.why == "weight":
        return "Check the signs at the robot, and masses and mounting in the model file"
    unsure = named(parts, np.asarray(decision.moving & (np.abs(decision.sign_odds) < LIKELY)))
    motion = f" log with more reversals of {unsure}" if unsure else " longer motion"
    return (
        f"A{motion} shows more"
        if decision.positions
        else f"A model file with masses, or a{motion}, shows more"
    )


def _order_finding(decision: Decision, parts: Sequence[str], where: str) -> Finding:
    order = [int(j) for j in decision.by]
    moved = np.asarray([j != i for i, j in enumerate(order)])
    if decision.level != "certain":
        return Doubt(
            SWAPPED,
            "yellow",
            f"The commands of {named(parts, moved)} fit these joints better in another order{where} "
            f"({_odds(decision)}), which is not certain.{_position_note(decision, named(parts, moved))}",
            f"Check the order of the columns. {_deciding_step(decision, parts)}; {accepted(SWAPPED)}.",
            flag=SWAPPED,
            by=decision.by,
        )
    pairs = ", ".join(f"{parts[i]} fits the column of {parts[j]}" for i, j in enumerate(order) if i != j)
    fact = (
        f"The commands of {named(parts, moved)} are swapped{where}: {pairs} ({_odds(decision)})."
        f"{_position_note(decision, named(parts, moved))}"
    )
    if decision.either_side:
        fact, step = f"{fact} {EITHER}", _side_step(SWAPPED)
        return Doubt(SWAPPED, _light(decision), fact, step, SWAPPED, by=decision.by)
    step = both(SWAPPED, "put them into this order")
    return Mendable(SWAPPED, _light(decision), fact, step, flag=SWAPPED, by=decision.by)


def _direction_finding(decision: Decision, where: str) -> Finding:
    fact = (
        f"The rows {_sure(decision)}run backwards in time{where}: inertia is positive and friction "
        f"negative in the commands of all joints ({_odds(decision)})."
    )
    if not decision.clear:
        fact += " Inverted signs are nearly as likely, so nothing is repaired."
        step = f"A log with velocities, or a model file with masses, decides; {accepted(DIRECTION)}."
        return Doubt(DIRECTION, "yellow", fact, step, flag=DIRECTION)
    return Mendable(
        DIRECTION, _light(decision), fact, both(DIRECTION, "reverse the order of the rows"), flag=DIRECTION
    )


def _delay_finding(decision: Decision, parts: Sequence[str], where: str) -> Finding:
    late = decision.by[0]
    direction = "behind" if late > 0.0 else "ahead of"
    if len(decision.by) > 1:
        joint = parts[int(decision.by[1])]
        fact = f"The commands of {joint} alone are {1e3 * abs(late):.0f} ms {direction} its motion{where}"
        step = f"Check the clocks of {joint} and of what moves it, and record again; {accepted(DELAY)}."
        return Doubt(DELAY, "yellow", f"{fact} ({_odds(decision)}).", step, DELAY, by=decision.by)
    fact = f"The commands are {1e3 * abs(late):.0f} ms {direction} the motion{where} ({_odds(decision)})."
    if decision.level == "note":
        step = "Ingestion shifts them by this time."
        return Mendable(DELAY, "yellow", fact, step, by=decision.by)
    step = both(DELAY, "shift them by this time")
    return Mendable(DELAY, "yellow", fact, step, flag=DELAY, by=decision.by)


def _gravity_finding(decision: Decision) -> Finding:
    part, deviation = decision.by
    return Finding(
        GRAVITY,
        "yellow",
        f"The commands contain {part:.2f} +- {deviation:.2f} of the model file's gravity over all joints: "
        "gravity seems to be compensated elsewhere.",
        f"Log the whole command, or check masses and mounting in the model file; {accepted(GRAVITY)}.",
        flag=GRAVITY,
    )


def _log_description(source: str, log: Log) -> str:
    """As "log 1" or "log 2 (the sign of the commands of elbow was turned, as asked)"."""
    requested = [one[:1].lower() + one[1:-1] for one in log.repairs if one.endswith(", as asked.")]
    repaired = [one for one in requested if "used without a repair" not in one.lower()]
    return f"{source} ({'; '.join(repaired)})" if repaired else source


def _without_partial_repair(finding: Finding, learned: Sequence[str]) -> Finding:
    """The finding on logs that were learned before: Étude repairs all of them or none."""
    step = (
        f"These logs are already learned: {', '.join(learned)}. Remove them (etude untell FOLDER NUMBER), "
        f"and ingest all logs together with --repair {finding.check}; {accepted(finding.check)}."
    )
    return replace(finding, step=step)
