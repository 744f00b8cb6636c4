"""Headline: alerts, the result, its robot time, and the error before learning."""

from __future__ import annotations

import numpy as np

from etude.campaign.record.alerts import campaign_alerts, motion_open
from etude.codes import Notice
from etude.report.markup import (
    Baseline,
    Html,
    baseline,
    duration,
    element,
    join,
    missing_data,
    number,
    ordered_baselines,
    paragraph,
    test_name,
    times,
)
from etude.report.record import (
    Evaluation,
    Record,
    Test,
    chosen_structure,
    new_motion,
    robot_seconds,
    score,
    structure_name,
    tests,
)
from etude.types import Array

SAME = 0.02
"""Errors that differ by no more than this part are told as the same."""
LARGEST = 1000.0
"""nMSE above which its digits say nothing."""


def headline(record: Record) -> Html:
    """Bad news first, each with what to do; then plain sentences and four large numbers."""
    if not record.state.trained:
        return join([*_alerts(record), _untrained(record)])
    learned = [test for test in tests(record) if test.learned]
    if learned:
        first = paragraph(tracking_sentence(record, learned[0]), class_="lead")
        parts = [first, *map(_other_test, learned[1:]), _cards(record, learned[0])]
        return join([*_alerts(record), *parts])
    return join([*_alerts(record), _prequential(record)])


def _alerts(record: Record) -> list[Html]:
    """One paragraph for each alert, red ones first."""
    alerts = campaign_alerts(record.state, record.outputs, len(record.names))
    return [_alert_paragraph(notice) for notice in (*motion_open(record.state, record.folder), *alerts)]


def _alert_paragraph(notice: Notice) -> Html:
    sentence = notice.sentence
    line = f"{sentence[:1].upper()}{sentence[1:]}. {notice.step}".strip()
    return paragraph(line, class_=f"news {notice.light}")


def tracking_sentence(record: Record, test: Test) -> str:
    """What the learned controller reaches on one test, beside what there was before and what is possible."""
    now = test.learned[-1]
    count = sum(1 for r in record.state.ingested if r.number <= now.number) or now.number
    start = (
        f"After {_count(count)} ({duration(now.seconds)} of robot time) the robot follows "
        f"{test_name(test.name)} that is never used for training with a mean error of {now.text}."
    )
    return " ".join([start, *_comparisons(test, now)])


def _count(count: int) -> str:
    return f"{count} {'trajectory' if count == 1 else 'trajectories'}"


def _other_test(test: Test) -> Html:
    """One short sentence on a further test motion."""
    parts = [f"{shown.name} {evaluation.text}" for shown, evaluation in _baselines(test)]
    beside = f"; {', '.join(parts)}" if parts else ""
    return paragraph(f"On {test_name(test.name)}: {test.learned[-1].text}{beside}.")


def _comparisons(test: Test, now: Evaluation) -> list[str]:
    return [
        shown.sentence.format(error=evaluation.text, relation=_relation(evaluation, now))
        + _beaten(shown, evaluation, now)
        for shown, evaluation in _baselines(test)
    ]


def _beaten(shown: Baseline, evaluation: Evaluation, now: Evaluation) -> str:
    """Why what was learned may be better than a perfect model."""
    if shown is not baseline("perfect") or now.mean >= (1.0 - SAME) * evaluation.mean:
        return ""
    return (
        " The learned model is better than that: an exact inverse fits only the planned motion, but the "
        "logs also show delay and stiction."
    )


def _baselines(test: Test) -> list[tuple[Baseline, Evaluation]]:
    """What is known of each baseline, and its newest evaluation, in the order of telling."""
    names = ordered_baselines(list(test.baselines))
    return [(baseline(name), evaluation) for name in names if (evaluation := test.baseline(name))]


def _relation(other: Evaluation, now: Evaluation) -> str:
    if abs(other.mean - now.mean) <= SAME * now.mean:
        return "about the same"
    if other.mean < now.mean:
        return "better than the learned model"
    return f"{times(other.mean, now.mean)} as much"


def _cards(record: Record, test: Test) -> Html:
    now = test.learned[-1]
    cards = [
        _card("", duration(robot_seconds(record)), "total robot time"),
        _card("c1", now.text, "mean tracking error now"),
    ]
    cards += [_card(shown.style, evaluation.text, shown.card) for shown, evaluation in _baselines(test)]
    return element("div", *cards, class_="cards")


def _card(style: str, value: str, label: str) -> Html:
    return element("div", element("b", value), element("span", label), class_=f"card {style}".strip())


def _untrained(record: Record) -> Html:
    proposals = [r for r in record.state.rounds.values() if r.asked]
    have = "has" if len(proposals) == 1 else "have"
    if record.state.ingested:
        return missing_data("Logs were ingested, but no model has been trained on them yet.")
    if proposals:
        return missing_data(
            f"{_count(len(proposals))} {have} been proposed, but no log was ingested yet. Run the "
            "trajectory on the robot, then ingest its log with `etude tell`."
        )
    return missing_data("There is no trajectory yet. `etude ask` writes the first one.")


def _held_out(record: Record, structure: str | None) -> tuple[Array | None, Array | None]:
    """(dof,) nMSE of the model in use and of linear regression: on logs left out, else on a new log; None
    after a single one, which says nothing of new motion.
    """
    last = record.state.trained[-1].trained
    return new_motion(last) or (score(last, structure, "nmse"), score(last, "linear", "nmse"))


def _prequential(record: Record) -> Html:
    last = record.state.trained[-1].trained
    structure = chosen_structure(last)
    name, outputs = structure_name(structure), "mean over commands"
    error, linear = _held_out(record, structure)
    seconds = robot_seconds(record)
    count = len(record.state.learned) or len(record.state.ingested)
    logs = f"{count} {'log' if count == 1 else 'logs'} ({duration(seconds)} of robot time)"
    cards = [_card("", duration(seconds), "total robot time")]
    if error is None:
        sentence = (
            f"{logs} learned with the model “{name}”. There is no score yet: a model is scored on each "
            "log before training on it, so the first score comes with the second log."
        )
        return join([paragraph(sentence, class_="lead"), element("div", *cards, class_="cards")])
    sentence = f"After {logs} the model “{name}” {_explained(error)}in held-out data ({outputs})."
    cards.append(_card("c1", _figure(error), f"held-out nMSE, {outputs}"))
    if linear is not None:
        sentence += f" Linear regression on the same data {_explained(linear)}."
        cards.append(_card("c5", _figure(linear), "nMSE of linear regression"))
    return join([paragraph(sentence, class_="lead"), element("div", *cards, class_="cards")])


def _explained(error: Array) -> str:
    """What an nMSE (J,) means, in words; where a constant would do better, no share is explained."""
    mean = float(np.nanmean(error))
    if mean < 1.0:
        return f"explained {number(100.0 * (1.0 - mean))} % of the variance of the commands"
    return (
        f"was worse than a constant: its squared error is {_figure(error)} times the variance of the commands"
    )


def _figure(error: Array) -> str:
    mean = float(np.nanmean(error))
    return number(mean) if mean < LARGEST else f"over {LARGEST:,.0f}"
