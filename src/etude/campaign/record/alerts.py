"""Alerts of a campaign, computed from committed facts; `status` and the report show them first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from etude.campaign.record.events import Evaluated, MotionSent, PrequentialScore, summary
from etude.campaign.record.state import CHANGED, Round, State
from etude.codes import Alert, NextStep, Notice, Phrase, Warn

LEAST_COVERAGE = 0.8
"""Of the 95 % intervals, below which a model is surer of an output than it should be."""
NO_BETTER = 1.0
"""nMSE from which a constant would predict as well."""
BEATEN, WORSE = 1.1, 1.1
"""Error over that of linear regression, and over that of the round before, from which it is told."""
OF_TRAINING = (Warn.TOO_LITTLE_MOTION, Warn.ONE_TRAJECTORY, Warn.SLOW_MOTION)
"""Warnings of a training that are alerts: what is not to be believed, or is no better than linear."""
FEEDBACK = ("pd", "pid")
"""Simulated baselines without any model."""


def campaign_alerts(state: State, outputs: Sequence[str], axes: int) -> tuple[Notice, ...]:
    """What the user should know before any figure, red alerts first; () if nothing is wrong.

    Args:
        state: of the campaign.
        outputs: names of the commands.
        axes: number of coordinates of the path.
    """
    notices = [*_of_logs(state), *_of_training(state), *_of_scores(state, outputs), *_of_tests(state, axes)]
    return tuple(sorted(notices, key=lambda notice: notice.light != "red"))


def motion_open(state: State, folder: str | Path) -> tuple[Notice, ...]:
    """An alert about a motion of the robot that nothing says the end of, as after a crash; () without one.

    Args:
        state: of the campaign. folder: its own, as it is typed.
    """
    if state.sent is None or not isinstance(state.sent.fact, MotionSent):
        return ()
    fields = {"part": state.sent.fact.part, "number": state.sent.number, "time": state.sent.time[:16]}
    fields |= {"folder": str(folder), "driver": state.driver}
    return (Notice(Alert.MOTION_OPEN, fields, NextStep.LOOK_AND_RESUME, "red"),)


def _of_logs(state: State) -> list[Notice]:
    """Findings about logs that are used or await an answer; a changed robot only until the answer."""
    notices = []
    for r in state.ingested:
        for finding in r.ingested.findings if r.ingested else ():
            if finding.light not in ("red", "yellow") or (finding.check == CHANGED and not r.awaits_answer):
                continue
            fields = {"log": r.number, "check": finding.check, "found": finding.sentence.rstrip(".")}
            fields |= {"step": finding.step, "flag": finding.flag}
            notices.append(Notice(Alert.LOG_FINDING, fields, NextStep.OF_CHECK, finding.light))
    return notices


def _of_training(state: State) -> list[Notice]:
    """Findings of the newest training about the structure in use: unreliable, or no better than linear.

    Other warnings say how the training handled them, or concern inputs.
    """
    warnings = state.newest.warnings if state.newest else ()
    return [replace(one, light="yellow") for one in warnings if one.code in OF_TRAINING]


def _of_scores(state: State, outputs: Sequence[str]) -> list[Notice]:
    """Alerts about the scores on logs left out; a single log says nothing about new motion.

    Trainings of earlier versions have the score on the newest log before it was learned.
    """
    scores = state.newest.new_motion if state.newest else None
    if scores is not None:
        where = Notice(Phrase.LEFT_OUT, {"logs": scores.logs})
        chosen = Notice(Phrase.STRUCTURE, {"structure": state.newest.chosen if state.newest else ""})
        return _of_figures(state, outputs, scores.used, scores.linear, where, chosen)
    scored = next((r for r in reversed(state.trained) if _in_use(r).nmse), None)
    if scored is None:
        return _never_moved(_unmoved(state))
    where = Notice(Phrase.PREDICTED, {"log": scored.number})
    then = Notice(Phrase.STRUCTURE_THEN, {"structure": _structure_before(scored)})
    return _of_figures(state, outputs, _in_use(scored), _scores(scored, "linear").nmse, where, then)


def _of_figures(
    state: State,
    outputs: Sequence[str],
    used: PrequentialScore,
    linear: Sequence[Any],
    where: Notice,
    chosen: Notice,
) -> list[Notice]:
    """Alerts about the scores of the structure in use, beside the nMSE of linear regression."""
    unsure = tuple(
        Notice(Phrase.COVERAGE, {"output": name, "part": part})
        for name, part in zip(outputs, used.coverage, strict=False)
        if part is not None and part < LEAST_COVERAGE
    )
    fields = {"where": where, "coverage": unsure}
    narrow = Notice(Alert.NARROW_INTERVALS, fields, NextStep.TELL_SUCH_MOTION, "red")
    return [*[narrow] * bool(unsure), *_of_errors(outputs, used.nmse, linear, where, chosen, _unmoved(state))]


def _never_moved(still: Sequence[str]) -> list[Notice]:
    """An alert about outputs whose joints never moved; none without such outputs."""
    fields = {"outputs": tuple(still)}
    return [Notice(Alert.NEVER_MOVED, fields, NextStep.MOVE_OUTPUT, "red")] if still else []


def _unmoved(state: State) -> list[str]:
    """Outputs whose joints stood still in every learned log, as the newest training found."""
    return list(state.newest.unmoved) if state.newest else []


def _of_errors(
    outputs: Sequence[str],
    used: Sequence[Any],
    linear: Sequence[Any],
    where: Notice,
    chosen: Notice,
    unmoved: Sequence[str],
) -> list[Notice]:
    """Alerts about outputs that a constant, or linear regression, would have predicted as well.

    Args:
        outputs: names of the commands.
        used, linear: nMSE of each output, for the structure in use and for linear regression; None: unknown.
        where, chosen: phrases for the alert: source of the scores, and structure in use.
        unmoved: outputs whose joints never moved; their alert says so.
    """
    useless = _notable_outputs(outputs, used, lambda value, _: value >= NO_BETTER, linear)
    beaten = _notable_outputs(
        outputs, used, lambda value, other: BEATEN * other < value and other < NO_BETTER, linear
    )
    still = [name for name in outputs if name in unmoved]
    useless, beaten = ([n for n in names if n not in unmoved] for names in (useless, beaten))
    alerts = (
        (useless, Notice(Alert.CONSTANT_AS_GOOD, {"where": where}, NextStep.MOVE_JOINTS, "red")),
        (
            beaten,
            Notice(
                Alert.LINEAR_BETTER,
                {"where": where, "structure": chosen},
                _linear_next_step(used, linear),
                "yellow",
            ),
        ),
    )
    notices = [replace(one, fields={"outputs": tuple(names), **one.fields}) for names, one in alerts if names]
    return [*_never_moved(still), *notices]


def _linear_next_step(used: Sequence[Any], linear: Sequence[Any]) -> NextStep:
    """Next step where linear regression errs less; it is selected for all outputs or for none."""
    pairs = list(zip(used, linear, strict=False))
    better = all(u is not None and o is not None and o < min(u, NO_BETTER) for u, o in pairs)
    return NextStep.TELL_OR_LINEAR if better and len(pairs) == len(used) else NextStep.TELL_TO_CHOOSE


def coverages(scored: Round) -> Sequence[float | None]:
    """Fraction of each output's commands inside the intervals, on logs left out.

    Without such logs, on the log before it was learned; None if unknown.
    """
    scores = scored.trained.new_motion if scored.trained else None
    return (_in_use(scored) if scores is None else scores.used).coverage


def _in_use(r: Round) -> PrequentialScore:
    """Scores of the structure in use before this log was learned; empty for the first log."""
    return _scores(r, _structure_before(r))


def _structure_before(r: Round) -> str | None:
    """Structure in use before this log was learned."""
    return r.trained.in_use if r.trained else None


def _scores(r: Round, structure: str | None) -> PrequentialScore:
    return r.trained.score_of(structure or "") if r.trained else PrequentialScore()


def _notable_outputs(
    outputs: Sequence[str], values: Sequence[Any], notable: Any, others: Sequence[Any]
) -> list[str]:
    """Outputs with a notable value, beside that of linear regression; inf where that is unknown."""
    rows = [*others, *[None] * (len(values) - len(others))]
    return [
        name
        for name, value, other in zip(outputs, values, rows, strict=False)
        if value is not None and notable(value, math.inf if other is None else other)
    ]


def _of_tests(state: State, axes: int) -> list[Notice]:
    """Alerts about simulated tests with a larger error than under the previous model, or without a model."""
    notices = []
    for name in dict.fromkeys(e.test for _, e in state.evaluated):
        evaluations = [e for _, e in state.evaluated if e.test == name]
        rounds = [e for e in evaluations if not e.baseline]
        if not rounds:
            continue
        now, unit = _error(rounds[-1], axes)
        fields = {"test": name, "error": now, "unit": unit}
        alone = [_error(e, axes)[0] for e in evaluations if e.baseline in FEEDBACK]
        if alone and now > alone[-1]:
            fields |= {"alone": alone[-1]}
            notices.append(Notice(Alert.WORSE_THAN_FEEDBACK, fields, NextStep.ASK_LIKE_IT, "red"))
        elif any(
            _error(after, axes)[0] > WORSE * _error(before, axes)[0] for before, after in _last_pair(rounds)
        ):
            fields |= {"before": _error(rounds[-2], axes)[0]}
            notices.append(Notice(Alert.TEST_WORSE, fields, NextStep.SEE_REPAIRS, "yellow"))
    return notices


def _last_pair(rounds: Sequence[Evaluated]) -> list[tuple[Evaluated, Evaluated]]:
    return list(pairwise(rounds))[-1:]


def _error(run: Evaluated, axes: int) -> tuple[float, str]:
    return summary(run.errors, axes), run.unit
