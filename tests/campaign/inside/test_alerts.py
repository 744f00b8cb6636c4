"""Bad news, from facts given by hand: told first, red before yellow, and never beside "use the model"."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from small_robot import random_motion, write_log
from test_stopping import CONFIG, OPEN, RULES, series

from etude.campaign import Campaign, Evaluated, Round, State
from etude.campaign.evaluate.stopping import stop_verdict
from etude.campaign.record.alerts import campaign_alerts
from etude.campaign.record.state import CHANGED
from etude.cli import main
from etude.codes import Alert, NextStep, Notice, Stop, Warn
from etude.types import Finding
from journal_facts import fact, trained

pytestmark = pytest.mark.as_logged

OUTPUTS = ("hip", "knee")
GOOD = {"nmse": [0.01, 0.02], "z2": [1.0, 1.0], "coverage": [0.95, 0.93]}
LINEAR = {"nmse": [0.1, 0.2]}
TOLD = {"sha256": "a", "robot_seconds": 60.0}


def state(gp: dict[str, Any], told: dict[str, Any] | None = None, **round_: Any) -> State:
    learned = trained(predicted_by="gp", models={"gp": gp, "linear": LINEAR})
    return State(
        rounds={
            3: Round(3, ingested=fact("told", **TOLD, **(told or {})), trained=learned, order=1, **round_)
        }
    )


def news(found: State) -> list[tuple[str, str]]:
    """Codes and lights; of a log's finding its check."""
    told = campaign_alerts(found, OUTPUTS, 2)
    return [(str(one.fields.get("check", one.code)), one.light) for one in told]


def test_without_bad_news_nothing_is_said() -> None:
    assert news(state(GOOD)) == []
    assert news(State()) == []


@pytest.mark.parametrize(
    ("change", "told", "words"),
    [
        ({"coverage": [0.95, 0.79]}, ("narrow_intervals", "red"), "knee 79 %"),
        (
            {"nmse": [0.01, 0.23]},
            ("linear_better", "yellow"),
            "has a smaller error than gp, selected then",
        ),
        ({"nmse": [0.01, 0.21]}, None, ""),
        ({"coverage": [0.95, 0.81]}, None, ""),
        ({"coverage": [0.95, None]}, None, ""),
    ],
)
def test_scores(change: dict[str, Any], told: tuple[str, str] | None, words: str) -> None:
    found = campaign_alerts(state({**GOOD, **change}), OUTPUTS, 2)
    assert [(one.code, one.light) for one in found] == ([told] if told else [])
    assert all(words in finding.sentence and "hip" not in finding.sentence for finding in found)
    assert all(finding.step for finding in found)


def test_what_the_training_does_not_believe_is_told_until_the_next_one() -> None:
    short = Notice(Warn.TOO_LITTLE_MOTION, {"commands": ("hip",), "seconds": 9.0}, NextStep.TELL_MOVING)
    few = Notice(Warn.ONE_TRAJECTORY, {"command": "knee", "ratio": 3.0}, NextStep.TELL_ANOTHER)
    told = [short, Notice(Warn.PERHAPS_CHANCE, {"command": "knee", "ratio": 2.0}), few]
    own = state(GOOD)
    rounds = {3: replace(own.rounds[3], trained=replace(own.newest, warnings=tuple(told)))}
    found = campaign_alerts(replace(own, rounds=rounds), OUTPUTS, 2)
    assert found == (replace(short, light="yellow"), replace(few, light="yellow"))
    assert [one.step for one in found] == ["Ingest another log that moves it.", "Ingest another one."]
    later = Round(4, ingested=own.rounds[3].ingested, trained=own.newest, order=2)
    assert campaign_alerts(replace(own, rounds=rounds | {4: later}), OUTPUTS, 2) == ()


def test_a_short_log_stands_at_the_top(campaign: Campaign, tmp_path: Path, capsys: Any) -> None:
    """Of `status` and of the report, with what to do; and nobody is told to use the model."""
    path = write_log(tmp_path / "short.csv", random_motion(campaign, 1), 1, start=0.0)
    lines = path.read_text().splitlines()
    path.write_text(
        "\n".join([lines[0], *(line for line in lines[1:] if float(line.split(",")[0]) < 6.0)]) + "\n"
    )
    assert main(["tell", str(campaign.path), str(path), "--foreign"]) == 0
    capsys.readouterr()
    assert main(["status", str(campaign.path)]) == 0
    said = capsys.readouterr().out
    assert said.splitlines()[0].startswith("Look: all commands: too little motion in ")
    assert said.splitlines()[0].endswith("uncertain everywhere. Ingest another log that moves it.")
    assert "Stop:" not in said
    assert main(["report", str(campaign.path)]) == 0
    page = (campaign.path / "report.html").read_text()
    assert page.index("uncertain everywhere") < page.index("<h2")


def left_out(
    mixed: list[float | None],
    linear: list[float],
    number: int = 3,
    coverage: tuple[float, float] = (0.95, 0.95),
) -> State:
    """Two logs, each predicted from the other; the newest one, before it was learned, was easy."""
    used = {"nmse": mixed, "z2": [1.0, 1.0], "coverage": list(coverage)}
    found = {"logs": 2, "used": used, "linear": linear}
    models = {"gp": GOOD, "linear": LINEAR}
    learned = trained(chosen="mixed", predicted_by="gp", models=models, new_motion=found)
    return State(rounds={number: Round(number, ingested=fact("told", **TOLD), trained=learned, order=1)})


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (2.9, [("constant_as_good", "red"), ("linear_better", "yellow")]),
        (1.0, [("constant_as_good", "red")]),
        (0.99, []),
        (None, []),
    ],
)
def test_logs_left_out_decide(error: float | None, told: list[tuple[str, str]]) -> None:
    found = campaign_alerts(left_out([0.1, error], [0.2, 0.95]), OUTPUTS, 2)
    assert [(f.code, f.light) for f in found] == told
    assert all(f.sentence.startswith("knee: on 2 motions, each predicted from the others, ") for f in found)


def test_intervals_are_those_of_logs_left_out() -> None:
    (found,) = campaign_alerts(left_out([0.1, 0.1], [0.2, 0.2], coverage=(0.95, 0.5)), OUTPUTS, 2)
    assert (found.code, found.light) == (Alert.NARROW_INTERVALS, "red")
    assert "knee 50 %" in found.sentence


def test_blocks_of_a_single_log_decide_nothing() -> None:
    nmse = {"gp": [9.0, 9.0], "linear regression": [0.1, 0.1]}
    blocks = {"blocks": [3], "of": 20, "chosen": "gp", "nmse": nmse}
    own = Round(3, ingested=fact("told", **TOLD), trained=trained(chosen="gp", held_out=blocks), order=1)
    assert news(State(rounds={3: own})) == []


@pytest.mark.parametrize(
    ("mixed", "linear", "step"),
    [
        ([0.3, 2.9], [0.2, 0.9], 'rung = "linear" in campaign.toml'),
        ([0.1, 2.9], [0.2, 0.9], "is chosen for each output"),
        ([None, 2.9], [0.2, 0.9], "is chosen for each output"),
    ],
)
def test_linear_regression_is_advised_only_where_no_output_gets_worse(
    mixed: list[float | None], linear: list[float], step: str
) -> None:
    (found,) = (
        f for f in campaign_alerts(left_out(mixed, linear), OUTPUTS, 2) if f.code == Alert.LINEAR_BETTER
    )
    assert step in found.step


def test_what_is_worse_than_a_constant_is_not_advised() -> None:
    assert news(left_out([0.1, 2.9], [0.2, 1.05])) == [("constant_as_good", "red")]


def test_of_a_joint_that_did_not_move_that_is_said() -> None:
    own = left_out([0.1, 2.9], [0.2, 0.5])
    rounds = {3: replace(own.rounds[3], trained=replace(own.newest, unmoved=("knee",)))}
    (found,) = campaign_alerts(State(rounds=rounds), OUTPUTS, 2)
    assert (found.code, found.light) == (Alert.NEVER_MOVED, "red")
    assert "knee: almost no motion" in found.sentence
    assert "which moves it" in found.step


def test_a_log_in_which_a_joint_stands_still_says_so_first(
    campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = pl.read_csv(write_log(tmp_path / "log.csv", random_motion(campaign, 1), 1, start=0.0))
    joint = campaign.axes[-1]
    still = [
        pl.Series(name, np.full(len(frame), 0.3 if name.startswith(("q_", "position")) else 0.0))
        for name in frame.columns
        if joint in name and not any(word in name for word in ("tau", "command", "effort"))
    ]
    assert still
    torques = [name for name in frame.columns if joint in name and name not in [s.name for s in still]]
    held = [pl.Series(n, 0.1 * np.random.default_rng(1).standard_normal(len(frame))) for n in torques]
    frame.with_columns(*still, *held).write_csv(tmp_path / "still.csv")
    assert main(["tell", str(campaign.path), str(tmp_path / "still.csv"), "--foreign"]) == 0
    capsys.readouterr()
    assert main(["status", str(campaign.path)]) == 0
    said = capsys.readouterr().out
    assert f"RED: {joint}: almost no motion in any log" in said.splitlines()[0]
    assert 'rung = "linear"' not in said


def test_an_output_that_nothing_tells_of_stands_at_the_top(
    campaign: Campaign, tmp_path: Path, capsys: Any
) -> None:
    """After the first log nothing is red; after the second a constant would do as well."""
    for number in (1, 2):
        path = write_log(tmp_path / f"log{number}.csv", random_motion(campaign, number), number, start=0.0)
        header, *rows = [line.split(",") for line in path.read_text().splitlines()]
        rng, column = np.random.default_rng(number), header.index("tau_knee")
        for row in rows:
            row[column] = f"{5.0 * rng.standard_normal():.4f}"
        path.write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")
        assert main(["tell", str(campaign.path), str(path), "--foreign"]) == 0
        capsys.readouterr()
        assert main(["status", str(campaign.path)]) == 0
        said = capsys.readouterr().out
        if number == 1:
            assert "RED" not in said
            assert "ingest a second log" in said
    assert said.startswith("RED: knee: on 2 motions, each predicted from the others, a constant would have")
    assert "First repair the red findings." in said


def test_red_comes_before_yellow() -> None:
    gp = {"nmse": [0.2, 1e9], "coverage": [0.1, 0.95]}
    told = {"findings": [asdict(Finding("units", "yellow", "hip may be in mA", "Say --current."))]}
    assert news(state(gp, told)) == [
        ("narrow_intervals", "red"),
        ("constant_as_good", "red"),
        ("units", "yellow"),
        ("linear_better", "yellow"),
    ]


def test_a_changed_robot_is_news_until_it_is_answered_and_other_findings_while_the_log_is_used() -> None:
    told = {"findings": [asdict(Finding(CHANGED, "red", "the robot has changed", "Say --changed new."))]}
    assert news(state(GOOD, told, awaits_answer=True)) == [(CHANGED, "red")]
    assert news(state(GOOD, told)) == []
    other = {"findings": [asdict(Finding("sign", "red", "inverted", "Turn it."))]}
    assert news(state(GOOD, other)) == [("sign", "red")]
    assert news(state(GOOD, other, abandoned=True)) == []
    unknown = {"findings": [{**other["findings"][0], "certainty": 0.9}]}
    assert news(state(GOOD, unknown)) == [("sign", "red")]


@pytest.mark.parametrize(
    ("errors", "told"),
    [
        ([1.0, 0.9], []),
        ([1.0, 1.2], [("test_worse", "yellow")]),
        ([1.0, 2.2], [("worse_than_feedback", "red")]),
        ([1.0, 1.2, 1.1], []),
    ],
)
def test_tests_that_get_worse(errors: list[float], told: list[tuple[str, str]]) -> None:
    alone = 0, Evaluated(test="moves", baseline="pd", errors=(2.0, 2.0), unit="deg")
    rounds = [(i, Evaluated(test="moves", errors=(e, e), unit="deg")) for i, e in enumerate(errors, start=1)]
    assert news(replace(state(GOOD), evaluated=(alone, *rounds))) == told


INVERTED = Notice(Alert.LOG_FINDING, {"log": 3, "found": "its sign is inverted"}, light="red")
HARM = [({"coverage": 0.79}, "79 %"), ({"red": (INVERTED,)}, "log 3: its sign is inverted")]


@pytest.mark.parametrize(("harm", "words"), HARM)
@pytest.mark.parametrize(("rule", "change"), RULES)
def test_no_rule_fires_while_the_model_may_do_harm(
    harm: dict[str, Any], words: str, rule: str, change: dict[str, Any]
) -> None:
    assert stop_verdict(series(change, change), CONFIG).rule == rule
    verdict = stop_verdict(series(change, {**change, **harm}), CONFIG)
    assert (verdict.stop, verdict.usable) == (False, False)
    assert words in verdict.reason


@pytest.mark.parametrize(("harm", "words"), HARM)
def test_a_spent_budget_stops_and_does_not_praise_the_model(harm: dict[str, Any], words: str) -> None:
    spent = replace(CONFIG, budget_trajectories=2)
    verdict = stop_verdict(series({}, harm), spent)
    assert (verdict.stop, verdict.rule, verdict.usable) == (True, "budget", False)
    assert words in verdict.reason
    assert stop_verdict(series({}, {}), spent).usable
    assert stop_verdict(series({}, {"coverage": 0.81}), CONFIG).usable
    assert OPEN.red == ()


@pytest.mark.parametrize("harm", [own for own, _ in HARM])
def test_where_no_rule_has_fired_the_reason_stands_alone(harm: dict[str, Any]) -> None:
    for logs, code in ((1, Stop.LOGS_MISSING), (2, Stop.OPEN)):
        found = stop_verdict(series(*[{}] * (logs - 1), harm), CONFIG)
        assert (found.notice.code, found.usable, ", but " in found.reason) == (code, False, False)
    doubted = {"forecast": 0.01, "calibration": 2.5}
    found = stop_verdict(series(doubted, {**doubted, **harm}), CONFIG)
    assert (found.notice.code, found.reason.count(", but ")) == (Stop.DOUBTED, 2)
