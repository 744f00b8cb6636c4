"""Bad news of a campaign, read from committed facts: what stands first in `status` and in the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from etude.campaign.record.events import Evaluated, PrequentialScore
from etude.campaign.record.rounds import summary
from etude.campaign.record.state import CHANGED, Round, State
from etude.models.selection.selection_rule import TOO_FEW, UNCERTAIN
from etude.types import Finding

LEAST_COVERAGE = 0.8
"""Of the 95 % intervals, below which a model is surer of an output than it should be."""
NO_BETTER = 1.0
"""nMSE from which a constant would predict as well."""
BEATEN, WORSE = 1.1, 1.1
"""Error over that of linear regression, and over that of the round before, from which it is told."""
TOLD_BY_TRAINING = {UNCERTAIN: "too little motion", TOO_FEW: "linear regression"}
"""Words of a training's warnings that are told here, and of which check they are."""
FEEDBACK = ("pd", "pid")
"""Simulated baselines without any model."""


def bad_news(state: State, outputs: Sequence[str], axes: int) -> tuple[Finding, ...]:
    """What the user should know before any figure, red lights first; empty if nothing is wrong.

    Args:
        outputs: names of the commands.
        axes: how many coordinates the path has.
    """
    scores = [*_of_scores(state, outputs), *_of_blocks(state, outputs)]
    found = [*_of_logs(state), *_of_training(state), *scores, *_of_tests(state, axes)]
    return tuple(sorted(found, key=lambda finding: finding.light != "red"))


def _of_logs(state: State) -> list[Finding]:
    """What was found when logs were told that are used or wait; a changed robot only until it is answered."""
    found = []
    for r in state.told:
        for finding in r.told.findings if r.told else ():
            if finding.light not in ("red", "yellow") or (finding.check == CHANGED and not r.held):
                continue
            sentence = f"log {r.number}: {finding.sentence.rstrip('.')}"
            found.append(Finding(finding.check, finding.light, sentence, finding.step, finding.flag))
    return found


def _of_training(state: State) -> list[Finding]:
    """What the newest training says of what is in use: nothing to be believed, or no better than linear.

    Other warnings say what was done about it, or are of inputs.
    """
    newest, found = state.newest, []
    for sentence in newest.warnings if newest else ():
        check = next((name for words, name in TOLD_BY_TRAINING.items() if words in sentence), None)
        if check is not None:
            fact, _, step = sentence.rstrip(".").rpartition("; ")
            found.append(Finding(check, "yellow", fact, f"{step[:1].upper()}{step[1:]}."))
    return found


def _of_scores(state: State, outputs: Sequence[str]) -> list[Finding]:
    """Of the newest log that was predicted before it was learned."""
    scored = next((r for r in reversed(state.trained) if _in_use(r).nmse), None)
    if scored is None:
        return []
    used, linear = _in_use(scored).nmse, _scores(scored, "linear").nmse
    where = f"on log {scored.number}, predicted before it was learned"
    coverage = coverages(scored)
    unsure = [(n, c) for n, c in zip(outputs, coverage, strict=False) if c is not None and c < LEAST_COVERAGE]
    found = []
    if unsure:
        parts = ", ".join(f"{name} {100 * c:.0f} %" for name, c in unsure)
        found.append(
            Finding(
                "calibration",
                "red",
                f"the model is surer than it is right: {where}, its 95 % intervals held {parts}",
                "Do not use its deviations yet: tell another log, of motion like that which it is for.",
            )
        )
    then = f"{_then(scored)}, then in use"
    return [*found, *_of_errors(outputs, used, linear, where, then, _unmoved(state))]


def _of_blocks(state: State, outputs: Sequence[str]) -> list[Finding]:
    """Of the newest log, where some of its blocks were held out: all there is to tell after the first one."""
    blocks = state.newest.held_out if state.newest else None
    if blocks is None:
        return []
    where = f"on blocks of log {state.trained[-1].number} that were held out"
    used, linear = blocks.nmse.get(blocks.chosen, ()), blocks.nmse.get("linear regression", ())
    return _of_errors(outputs, used, linear, where, blocks.chosen, _unmoved(state))


def _unmoved(state: State) -> list[str]:
    """Outputs whose joints did not move in any log that was learned, as the newest training found."""
    return list(state.newest.unmoved) if state.newest else []


def _of_errors(
    outputs: Sequence[str],
    used: Sequence[Any],
    linear: Sequence[Any],
    where: str,
    chosen: str,
    unmoved: Sequence[str],
) -> list[Finding]:
    """Outputs that a constant, or linear regression, would have predicted as well.

    Args:
        used, linear: nMSE of each output, of what is or was in use and of linear regression; None: unknown.
        unmoved: outputs whose joints never moved: what is said of these is that.
    """
    useless = _named(outputs, used, lambda value, _: value >= NO_BETTER, linear)
    beaten = _named(outputs, used, lambda value, other: BEATEN * other < value and other < NO_BETTER, linear)
    still = [name for name in useless if name in unmoved]
    useless, beaten = ([n for n in names if n not in unmoved] for names in (useless, beaten))
    found = []
    if still:
        found.append(
            Finding(
                "prediction",
                "red",
                f"{', '.join(still)}: it did not move in any log, so nothing was learned of it",
                "Do not use this output yet: move it, as the motion that etude ask writes does, and tell "
                "that log.",
            )
        )
    if useless:
        found.append(
            Finding(
                "prediction",
                "red",
                f"{', '.join(useless)}: {where}, a constant would have predicted as well",
                "Do not use these outputs yet: move these joints more, and look at the log.",
            )
        )
    if beaten:
        found.append(
            Finding(
                "linear regression",
                "yellow",
                f"{', '.join(beaten)}: {where}, linear regression erred less than {chosen}",
                _instead(used, linear),
            )
        )
    return found


def _instead(used: Sequence[Any], linear: Sequence[Any]) -> str:
    """What to do where linear regression errs less: it is chosen for all outputs or for none."""
    pairs = list(zip(used, linear, strict=False))
    better = all(u is not None and o is not None and o < min(u, NO_BETTER) for u, o in pairs)
    if better and len(pairs) == len(used):
        return 'Tell another log; if it stays so, rung = "linear" in campaign.toml.'
    return "Tell another log: what errs least on it is chosen for each output."


def coverages(scored: Round) -> list[float | None]:
    """Of each output, the part of the commands inside the intervals of the model then in use."""
    return list(_in_use(scored).coverage)


def _in_use(r: Round) -> PrequentialScore:
    """Scores of what was in use when this log came; empty for the first log."""
    return _scores(r, _then(r))


def _then(r: Round) -> str | None:
    """What was in use when this log came."""
    return r.trained.in_use if r.trained else None


def _scores(r: Round, rung: str | None) -> PrequentialScore:
    return r.trained.score_of(rung or "") if r.trained else PrequentialScore()


def _named(outputs: Sequence[str], values: Sequence[Any], told: Any, others: Sequence[Any]) -> list[str]:
    """Outputs whose value is told of, beside that of linear regression; inf where that is not known."""
    rows = [*others, *[None] * (len(values) - len(others))]
    return [
        name
        for name, value, other in zip(outputs, values, rows, strict=False)
        if value is not None and told(value, math.inf if other is None else other)
    ]


def _of_tests(state: State, axes: int) -> list[Finding]:
    """Simulated tests that the newest model does worse than the one before, or than no model at all."""
    found = []
    for name in dict.fromkeys(e.test for _, e in state.evaluated):
        own = [e for _, e in state.evaluated if e.test == name]
        rounds = [e for e in own if not e.baseline]
        if not rounds:
            continue
        now, unit = _error(rounds[-1], axes)
        alone = [_error(e, axes)[0] for e in own if e.baseline in FEEDBACK]
        if alone and now > alone[-1]:
            sentence = (
                f"test {name}: with the model the error is {now:.3g} {unit}, without it {alone[-1]:.3g}"
            )
            step = "Do not use the model on such motion; ask for more, with tasks like it (--tasks)."
            found.append(Finding("tests", "red", sentence, step))
        elif any(_error(after, axes)[0] > WORSE * _error(before, axes)[0] for before, after in _last(rounds)):
            before = _error(rounds[-2], axes)[0]
            sentence = f"test {name} got worse with the last log: {before:.3g} to {now:.3g} {unit}"
            step = "Look at that log's repairs; etude untell takes it back if something is wrong with it."
            found.append(Finding("tests", "yellow", sentence, step))
    return found


def _last(rounds: Sequence[Evaluated]) -> list[tuple[Evaluated, Evaluated]]:
    return list(pairwise(rounds))[-1:]


def _error(run: Evaluated, axes: int) -> tuple[float, str]:
    return summary(run.errors, axes), run.unit
