"""Margins by kind of control: a log tells of motions under its own control, and of no others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_robot import make_campaign, write_log

from certificate_schema import valid
from etude import ask, tell, untell
from etude.campaign import (
    FEEDBACK,
    LEARNED,
    Asked,
    Campaign,
    Exported,
    Round,
    State,
    ask_to_confirm,
    open_campaign,
    simulate,
    stored_trajectory,
)
from etude.campaign.propose.constraints import (
    constraints_now,
    constraints_then,
    constraints_under,
    seen_errors,
)
from etude.campaign.propose.export import export
from etude.campaign.record.controls import FILE, IN_WORDS, asked_under, required
from etude.campaign.record.events import Ingested
from etude.errors import UsageError
from etude.limits import HIDDEN
from etude.types import Array

pytestmark = pytest.mark.as_logged

RANDOM = '[trajectory]\nduration = 8.0\n[data]\ncutoff_hz = 5.0\n[design]\nfirst = "random"\n'
LEARNS = """\
[model]
rung = "linear"
fit_points = 60
points = 60
steps = 2
"""


@pytest.fixture
def lab(tmp_path: Path) -> Campaign:
    return make_campaign(tmp_path, config=RANDOM + LEARNS)


def told(*logs: tuple[float, str | None]) -> State:
    """Logs with these largest errors under these controls; None: of before this was kept."""
    rounds = {}
    for i, (size, control) in enumerate(logs, 1):
        tracked = {"fourier": ((size, size), (size, size), (0.0, 0.0))}
        log = Ingested(sha256=str(i), tracked=tracked, control=control or "")
        rounds[i] = Round(i, Asked(status=""), log, ingested_at=str(i))
    return State(rounds=rounds)


def kept(lab: Campaign, state: State, *controls: str) -> tuple[np.ndarray, np.ndarray]:
    table, sure = constraints_now(lab, state, *controls).margins["fourier"]
    return np.asarray(table), np.asarray(sure)


@pytest.mark.parametrize("control", IN_WORDS)
@pytest.mark.parametrize("size", [1e-4, 0.02, 5.0])
def test_a_log_under_another_control_changes_nothing(lab: Campaign, control: str, size: float) -> None:
    """Neither small errors nor large ones, nor how many logs there are, nor what is said of them."""
    for own in ([], [(0.01, control)], [(0.01, control), (0.012, control)]):
        before = constraints_now(lab, told(*own), control)
        others = [(size, other) for other in IN_WORDS if other != control]
        after = constraints_now(lab, told(*own, *others * 4), control)
        assert before.margins.keys() == after.margins.keys()
        for form, pair in before.margins.items():
            np.testing.assert_array_equal(np.stack(after.margins[form]), np.stack(pair))
        assert after.by_form == before.by_form


def test_before_a_log_of_its_control_a_margin_is_the_start_value_and_assumed(lab: Campaign) -> None:
    start, sure = kept(lab, told(), LEARNED)
    np.testing.assert_array_equal(kept(lab, told((0.001, FEEDBACK)), LEARNED)[0], start)
    np.testing.assert_array_equal(kept(lab, told((0.001, FEEDBACK)), LEARNED)[1], sure)
    assert not sure.any()
    table, sure = kept(lab, told((0.001, FEEDBACK), (0.002, LEARNED)), LEARNED)
    np.testing.assert_allclose(table, beyond(0.006))  # of one log: three times, however many others have


def test_what_is_learned_anew_after_each_log_is_assumed_until_the_fourth(lab: Campaign) -> None:
    for count in (1, 3):
        assert not kept(lab, told(*[(0.002, LEARNED)] * count), LEARNED)[1].any()
        np.testing.assert_array_equal(kept(lab, told(*[(0.002, FILE)] * count), FILE)[1], 0.95)
        np.testing.assert_array_equal(kept(lab, told(*[(0.002, FEEDBACK)] * count), FEEDBACK)[1], 0.95)
    np.testing.assert_array_equal(kept(lab, told(*[(0.002, LEARNED)] * 4), LEARNED)[1], 0.95)


def beyond(error: float) -> Array:
    """The margins (O, k) of errors of that size: velocities have more, their limit is 1 rad/s."""
    return np.array([[error, error], [error + HIDDEN, error + HIDDEN]])


def test_a_log_of_before_counts_for_each_control(lab: Campaign) -> None:
    for control in IN_WORDS:
        np.testing.assert_allclose(kept(lab, told((0.001, None)), control)[0], beyond(0.003))
        both = told((0.004, None), (0.001, control))
        np.testing.assert_allclose(kept(lab, both, control)[0], beyond(0.008))


def test_for_either_control_the_larger_margin_is_kept(lab: Campaign) -> None:
    state = told((0.004, FEEDBACK), *[(0.001, LEARNED)] * 4)
    both, sure = kept(lab, state, FEEDBACK, LEARNED)
    np.testing.assert_allclose(both, beyond(0.012))
    np.testing.assert_array_equal(sure, 0.95)
    both, sure = kept(lab, told((0.001, FEEDBACK)), FEEDBACK, LEARNED)
    np.testing.assert_array_equal(both, kept(lab, told(), LEARNED)[0])
    assert not sure.any()  # the larger one is assumed


def run(lab: Campaign, folder: Path, number: int, **how: Any) -> Path:
    log = write_log(folder / f"{number}.csv", stored_trajectory(lab, number))
    tell(lab, log, number=number, **how)
    return log


def rows(lab: Campaign, number: int) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = valid((lab.proposal(number) / "certificate.json").read_bytes())["rows"]
    return found


def test_a_certificate_says_which_control_its_margins_are_of(lab: Campaign, tmp_path: Path) -> None:
    ask(lab)
    own = [row for row in rows(lab, 1) if row["tracking_margin"] > 0.0]
    assert {row["control"] for row in own} == {"feedback alone"}
    assert all("tracking margin under feedback alone" in row["in_words"] for row in own)
    assert all("control" not in row for row in rows(lab, 1) if row["tracking_margin"] == 0.0)
    run(lab, tmp_path, 1)
    found = ask(lab, control=LEARNED)
    assert asked_under(lab.round(2).asked) == (LEARNED,)
    own = [row for row in rows(lab, 2) if row["tracking_margin"] > 0.0]
    assert {row["control"] for row in own} == {"learned feedforward"}
    assert {row["confidence"] for row in own} == {0.0}
    unseen = found.certificate.not_verified[0]
    assert "no log of such a motion under learned feedforward confirms the margins of" in unseen


def test_a_log_has_the_control_that_its_motion_was_asked_for(lab: Campaign, tmp_path: Path) -> None:
    ask(lab)
    log = run(lab, tmp_path, 1)
    assert lab.round(1).ingested.control == FEEDBACK
    before = lab.events()
    tell(lab, log, control=LEARNED)  # told twice is told once, whatever is said with it
    assert lab.events() == before
    assert seen_errors(lab.state(), FEEDBACK)
    assert not seen_errors(lab.state(), LEARNED)
    untell(lab, 1)
    tell(lab, log, number=1, control=FILE)
    assert [bool(seen_errors(lab.state(), c)) for c in (FEEDBACK, FILE, LEARNED)] == [False, True, False]


def test_folded_again_the_journal_gives_the_same_margins(lab: Campaign, tmp_path: Path) -> None:
    ask(lab)
    run(lab, tmp_path, 1)
    ask(lab, control=LEARNED)
    run(lab, tmp_path, 2)
    again = open_campaign(lab.path)
    for control in IN_WORDS:
        live, replayed = (kept(one, one.state(), control) for one in (lab, again))
        np.testing.assert_array_equal(np.stack(live), np.stack(replayed))
    then = constraints_then(again.round(2).asked)
    assert then.controls == (LEARNED,)
    np.testing.assert_array_equal(then.margins["fourier"][0], kept(lab, told(), LEARNED)[0])


def test_an_open_proposal_is_not_for_another_control(lab: Campaign) -> None:
    ask(lab)
    with pytest.raises(UsageError, match="margins are for feedback alone"):
        ask(lab, control=FILE)
    assert ask(lab, control=FEEDBACK).number == 1
    assert ask(lab, control=FILE, new=True).number == 2
    with pytest.raises(UsageError, match="there is no model yet"):
        ask(lab, control=LEARNED, new=True)
    with pytest.raises(UsageError, match="no control 'none'"):
        ask(lab, control="none")
    with pytest.raises(UsageError, match="cannot be planned for feedback alone"):
        required(FEEDBACK, effort=True)


def test_run_under_a_control_that_it_was_not_asked_for(lab: Campaign, tmp_path: Path) -> None:
    """Its own margins, assumed, until a log of that control speaks; what was written keeps its own."""
    ask(lab)
    run(lab, tmp_path, 1)
    ask(lab)
    own, other = (constraints_under(lab, 2, c) for c in (FEEDBACK, LEARNED))
    np.testing.assert_array_equal(other.margins["fourier"][0], own.margins["fourier"][0])
    assert np.all(own.margins["fourier"][1] == 0.95)
    assert not np.any(other.margins["fourier"][1])
    assert other.controls == (LEARNED,)
    with lab.writing():
        lab.commit(other.recorded(Exported(format="x", effort=True)), 2)
    ask(lab, control=LEARNED, new=True)
    run(lab, tmp_path, 3)
    written = constraints_under(lab, 2, LEARNED).margins["fourier"]
    np.testing.assert_array_equal(np.stack(written), np.stack(other.margins["fourier"]))
    ask(lab, new=True)
    later = constraints_under(lab, 4, LEARNED)
    np.testing.assert_array_equal(
        np.stack(later.margins["fourier"]), np.stack(kept(lab, lab.state(), LEARNED))
    )
    assert lab.round(3).ingested.control == LEARNED


def test_written_with_the_learned_command_it_is_taken_to_be_run_so(tmp_path: Path) -> None:
    lab = make_campaign(tmp_path, config=RANDOM + LEARNS)
    ask(lab)
    tell(lab, write_log(tmp_path / "1.csv", stored_trajectory(lab, 1)))
    ask(lab)
    with lab.writing():
        motion = stored_trajectory(lab, 2)
        found = export(lab, 2, motion, lab.proposal(2), "ros2_yaml", effort=True)
    assert {row.control for row in found.certificate.rows if row.tracking_margin} == {"learned feedforward"}
    assert {row.confidence for row in found.certificate.rows if row.tracking_margin} == {0.0}
    tell(lab, write_log(tmp_path / "2.csv", motion))
    assert lab.round(2).ingested.control == LEARNED
    confirms = ask_to_confirm(lab)
    under = {row.control for row in confirms.certificate.rows if row.tracking_margin}
    assert under == {"feedback alone or learned feedforward"}


def test_without_margins_nothing_is_said_of_controls(tmp_path: Path) -> None:
    lab = make_campaign(tmp_path, config=RANDOM + '[tracking]\nmargin = "none"\n')
    ask(lab)
    assert all("control" not in row for row in rows(lab, 1))


@pytest.mark.slow
def test_a_simulated_robot_is_run_under_what_its_margins_are_of(tmp_path: Path) -> None:
    """Vehicles lean against the drag from the second flight on; an open proposal is flown as it was asked."""
    from etude.campaign import create_campaign

    sky, _ = create_campaign(tmp_path / "sky", "quadrotor", seed=4)
    text = (sky.path / "campaign.toml").read_text()
    text = text.replace("starts = 3", "starts = 1").replace("steps = 60", "steps = 3")
    (sky.path / "campaign.toml").write_text(text)
    sky = open_campaign(sky.path)
    list(simulate(sky, 2))
    assert [asked_under(sky.round(n).asked) for n in (1, 2)] == [(FEEDBACK,), (LEARNED,)]
    assert [sky.round(n).ingested.control for n in (1, 2)] == [FEEDBACK, LEARNED]
    side = [next(row for row in rows(sky, n) if row["axis"] == "x") for n in (1, 2)]
    assert [row["tracking_margin"] for row in side] == [
        sky.spec.margin
    ] * 2  # not what the first flight taught
    ask(sky, go_on=True)
    list(simulate(sky, 1))
    assert sky.round(3).ingested.control == FEEDBACK
