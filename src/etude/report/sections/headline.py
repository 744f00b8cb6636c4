"""The first screen: what was learned, for how much robot time, against what there was before."""

from __future__ import annotations

import numpy as np

from etude.report.curves import (
    BASELINES,
    TESTS,
    Array,
    Test,
    chosen_kind,
    held_out,
    kind_name,
    robot_seconds,
    score,
    tests,
)
from etude.report.markup import Html, duration, element, join, missing, number, paragraph, times
from etude.report.record import Record


def headline(record: Record) -> Html:
    """Plain sentences and four large numbers."""
    if not record.state.trained:
        return join([_untrained(record)])
    learned = [test for test in tests(record) if test.learned]
    if learned:
        first = paragraph(tracking_sentence(record, learned[0]), class_="lead")
        return join([first, *map(_other_test, learned[1:]), _cards(record, learned[0])])
    return _prequential(record)


def tracking_sentence(record: Record, test: Test) -> str:
    """What the learned controller reaches on one test, beside what there was before and what is possible."""
    now = test.learned[-1]
    what = TESTS.get(test.name, f"the test “{test.name}”")
    count = sum(1 for r in record.state.told if r.number <= now.number) or now.number
    start = (
        f"After {count} {'trajectory' if count == 1 else 'trajectories'} ({duration(now.seconds)} of robot "
        f"time) the robot follows {what} that it was never trained on with a mean error of "
        f"{number(now.mean)}°."
    )
    return " ".join([start, *_comparisons(test, now.mean)])


def _other_test(test: Test) -> Html:
    """One short sentence on a further test motion."""
    parts = [
        f"{BASELINES[name]} {number(found.mean)}°" for name in BASELINES if (found := test.baseline(name))
    ]
    beside = f"; {', '.join(parts)}" if parts else ""
    what = TESTS.get(test.name, f"the test “{test.name}”")
    return paragraph(f"On {what}: {number(test.learned[-1].mean)}°{beside}.")


def _comparisons(test: Test, now: float) -> list[str]:
    pd, rigid, perfect = (test.baseline(name) for name in ("pd", "rigid_body", "perfect"))
    sentences = []
    if pd:
        sentences.append(f"PD control alone has {number(pd.mean)}° ({times(pd.mean, now)} as much).")
    if rigid:
        relation = (
            f"{times(rigid.mean, now)} as much" if rigid.mean >= now else "better than what was learned"
        )
        sentences.append(f"PD with an identified rigid-body model has {number(rigid.mean)}° ({relation}).")
    if perfect:
        sentences.append(f"A perfect model of this robot has {number(perfect.mean)}°, about the floor.")
    return sentences


def _cards(record: Record, test: Test) -> Html:
    now = test.learned[-1]
    cards = [
        _card("", duration(robot_seconds(record)), "of robot time in all"),
        _card("c1", number(now.mean) + "°", "mean tracking error now"),
    ]
    for name, style, label in (
        ("pd", "c2", "with PD alone"),
        ("rigid_body", "c5", "with an identified rigid body"),
        ("perfect", "c3", "with a perfect model"),
    ):
        found = test.baseline(name)
        if found:
            cards.append(_card(style, number(found.mean) + "°", label))
    return element("div", *cards, class_="cards")


def _card(style: str, value: str, label: str) -> Html:
    return element("div", element("b", value), element("span", label), class_=f"card {style}".strip())


def _untrained(record: Record) -> Html:
    asked = [r for r in record.state.rounds.values() if r.asked]
    if record.state.told:
        return missing("Logs have been told, and no model has been trained from them yet.")
    if asked:
        return missing(
            f"{len(asked)} {'trajectory has' if len(asked) == 1 else 'trajectories have'} been proposed, and "
            "no log has come back yet. Run the trajectory on the robot, then `etude tell` with its log."
        )
    return missing("Nothing has been asked yet. `etude ask` writes the first trajectory.")


def _held_out(record: Record, kind: str | None) -> tuple[Array | None, Array | None]:
    """(dof,) nMSE of the model in use and of linear regression: on a new log, else on held-out blocks."""
    last = record.state.trained[-1].trained
    error, linear = score(last, kind, "nmse"), score(last, "linear", "nmse")
    if error is not None:
        return error, linear
    newest = next((b for r in reversed(record.state.trained) if (b := held_out(r.trained))), {})
    return newest.get(str(kind)), newest.get("linear regression")


def _prequential(record: Record) -> Html:
    last = record.state.trained[-1].trained
    kind = chosen_kind(last)
    error, linear = _held_out(record, kind)
    seconds = robot_seconds(record)
    count = len(record.state.told) or len(record.state.trained)
    logs = f"{count} {'log' if count == 1 else 'logs'} ({duration(seconds)} of robot time)"
    cards = [_card("", duration(seconds), "of robot time in all")]
    if error is None:
        sentence = (
            f"{logs} learned with the model “{kind_name(kind)}”. There is no score yet: a model is "
            "scored on a log before it learns from it, so the first score comes with the second log."
        )
        return join([paragraph(sentence, class_="lead"), element("div", *cards, class_="cards")])
    explained = 100.0 * (1.0 - float(np.nanmean(error)))
    sentence = (
        f"After {logs} the model “{kind_name(kind)}” explained {number(explained)} % of the variance of the "
        "commands in held-out data that it had not learned from (mean over joints)."
    )
    cards.append(_card("c1", number(float(np.nanmean(error))), "held-out nMSE, mean over joints"))
    if linear is not None:
        share = 100.0 * (1.0 - float(np.nanmean(linear)))
        sentence += f" Linear regression on the same data explained {number(share)} %."
        cards.append(_card("c5", number(float(np.nanmean(linear))), "nMSE of linear regression"))
    return join([paragraph(sentence, class_="lead"), element("div", *cards, class_="cards")])
