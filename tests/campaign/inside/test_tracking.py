"""Margins of a campaign: learned by form, kept with each proposal, said in the certificate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_robot import ALONE, make_campaign, write_log

from certificate_schema import valid
from etude import ask, tell
from etude.campaign import Asked, Campaign, Round, State, create_campaign, open_campaign, stored_trajectory
from etude.campaign.propose.constraints import constraints_now, constraints_then
from etude.cli import main
from etude.errors import UsageError
from etude.limits import HIDDEN
from etude.protocols import Trajectory
from etude.trajectories import FourierTrajectory, PointToPoint
from etude.types import Proof
from journal_facts import fact

pytestmark = pytest.mark.as_logged

RANDOM = '[trajectory]\nduration = 8.0\n[data]\ncutoff_hz = 5.0\n[design]\nfirst = "random"\n' + ALONE


@pytest.fixture
def lab(tmp_path: Path) -> Campaign:
    return make_campaign(tmp_path, config=RANDOM)


def run_and_tell(lab: Campaign, folder: Path, number: int, speed: int = 100) -> None:
    log = write_log(folder / f"{number}.csv", stored_trajectory(lab, number, speed))
    tell(lab, log, number=number)


def rows(lab: Campaign, number: int, quantity: str) -> list[dict[str, float]]:
    found = valid((lab.proposal(number) / "certificate.json").read_bytes())["rows"]
    return [row for row in found if row["quantity"] == quantity]


def test_before_any_log_the_margin_is_assumed(lab: Campaign) -> None:
    found = ask(lab)
    assert [row["tracking_margin"] for row in rows(lab, 1, "position")] == pytest.approx([0.04, 0.04])
    assert [row["tracking_margin"] for row in rows(lab, 1, "velocity")] == pytest.approx([0.25, 0.25])
    assert all(row["confidence"] == 0.0 for row in rows(lab, 1, "position"))
    assert [row["upper"] for row in rows(lab, 1, "position")] == pytest.approx([0.96, 0.46])
    assert any("no log of such a motion" in sentence for sentence in found.certificate.not_verified)


def test_a_log_is_measured_and_the_next_margin_is_three_times_its_error(
    lab: Campaign, tmp_path: Path
) -> None:
    ask(lab)
    run_and_tell(lab, tmp_path, 1)
    told = lab.state().rounds[1].ingested
    assert told is not None
    table = np.array(told.tracked["fourier"], dtype=float)
    assert table.shape == (3, 2)
    assert np.isnan(table[2]).all(), "the log is the plan, and noise"
    motion = stored_trajectory(lab, 1)
    assert 0.0 < table[0].max() < 0.05
    margins = constraints_now(lab, lab.state()).margins
    hidden = np.array([[0.0], [HIDDEN]]) * lab.kind.expected(lab.spec).limits["qd"][1]
    np.testing.assert_allclose(margins["fourier"][0], 3.0 * table[:2] + hidden)
    np.testing.assert_array_equal(margins["fourier"][1], 0.95)
    assert not np.any(margins["moves"][1])
    found = constraints_now(lab, lab.state()).of(motion).unenforced
    assert len(found) == 1
    assert found[0].startswith("Acceleration: the noise of logged positions hides by how much tracking")
    assert found[0].endswith("Fourier motions: hip, knee.")


def test_a_proposal_keeps_the_margins_of_its_time(lab: Campaign, tmp_path: Path) -> None:
    ask(lab)
    second = ask(lab, new=True).number
    before = [constraints_then(lab.state().rounds[n].asked).margins["fourier"] for n in (1, second)]
    text = (lab.proposal(second) / "certificate.json").read_bytes()
    run_and_tell(lab, tmp_path, 1)
    again = ask(open_campaign(lab.path))
    assert (again.number, again.new) == (second, False)
    assert [row.tracking_margin for row in again.certificate.rows if row.quantity == "position"] == [
        0.04,
        0.04,
    ]
    assert (lab.proposal(second) / "certificate.json").read_bytes() == text
    for pair in before:
        np.testing.assert_allclose(pair[0], [[0.04, 0.04], [0.25, 0.25]])


def test_a_slower_run_says_nothing_of_the_full_one(lab: Campaign, tmp_path: Path) -> None:
    ask(lab, speed=50)
    run_and_tell(lab, tmp_path, 1, speed=50)
    assert lab.state().rounds[1].ingested.tracked == {}


def test_ask_says_slowly_first_until_a_log_shows_how_far_it_leaves_its_plan(
    lab: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def slowly(*arguments: str) -> bool:
        assert main(["ask", str(lab.path), *arguments]) == 0
        return any(line.startswith("Run it slowly first") for line in capsys.readouterr().out.splitlines())

    assert slowly()
    assert not slowly("--speed", "50")
    run_and_tell(lab, tmp_path, 1)
    assert not slowly()
    assert slowly("--control", "learned", "--new")


def test_a_large_error_is_cut_to_the_room_and_said(lab: Campaign) -> None:
    large = lab.kind.expected(lab.spec).limits["q"]
    state = lab.state()
    assert large[1][0] == 1.0
    kept = constraints_now(_with_gains(lab, (400.0, 5.0)), state)
    np.testing.assert_allclose(kept.margins["fourier"][0][0], [0.05, 0.1])
    np.testing.assert_array_equal(kept.margins["fourier"][1][0], [1.0, 0.0])
    (sentence,) = kept.by_form["fourier"] if kept.by_form else ("",)
    assert sentence.startswith(
        "Tracking: the error in position of knee may reach 2 rad; the margin is only 0.1"
    )


def _with_gains(lab: Campaign, kp: tuple[float, float]) -> Campaign:
    """Largest commands are 20 and 10 N m."""
    path = lab.path / "robot.toml"
    path.write_text(path.read_text() + f"[gains]\nkp = {list(kp)}\n")
    return open_campaign(lab.path)


def test_impossible_gains_are_refused(lab: Campaign) -> None:
    with pytest.raises(UsageError, match="kp"):
        _with_gains(lab, (1.0, -1.0))


def test_without_margins_nothing_is_kept_or_stored(tmp_path: Path) -> None:
    lab = make_campaign(tmp_path, config=RANDOM + '[tracking]\nmargin = "none"\n')
    ask(lab)
    asked = lab.state().rounds[1].asked
    assert asked is not None
    assert (asked.margins, asked.unheld) == ({}, ())
    assert all(row["tracking_margin"] == 0.0 for row in rows(lab, 1, "velocity"))
    assert constraints_then(Asked(status="")).margins == {}
    assert constraints_then(None).margins == {}


def test_a_flight_keeps_its_owners_room_unless_logs_show_more(tmp_path: Path) -> None:
    campaign, _ = create_campaign(tmp_path / "sky", "quadrotor")

    series = FourierTrajectory(np.zeros((3, 3)), 1.0, 10.0)

    def box(*largest: float, motion: Trajectory = series) -> Proof:
        """The row of x of a motion after series with these errors."""
        rounds = {
            i: Round(
                i,
                ingested=fact(
                    "told", sha256="", tracked={"fourier": [[size, 0.0, 0.0], [0.1] * 3, [0.0] * 3]}
                ),
            )
            for i, size in enumerate(largest, 1)
        }
        (found,) = [
            limit
            for limit in campaign.limits(constraints_now(campaign, State(rounds=rounds)).margins)
            if limit.name == "position"
        ]
        return found.prove(motion)[0]

    assert (box().tracking_margin, box().confidence) == (1.0, 0.0)  # no log shows that it is enough
    assert (box(0.1).tracking_margin, box(0.1).confidence) == (1.0, 0.95)
    assert box(0.5).tracking_margin == pytest.approx(1.5)
    assert box(0.5, 0.6, 0.4, 0.1).tracking_margin == pytest.approx(1.0)  # 0.9 is less than its owner keeps
    move = PointToPoint(np.array([np.zeros(3), np.ones(3)]), 1.0)
    assert (box(0.5, motion=move).tracking_margin, box(0.5, motion=move).confidence) == (1.5, 0.0)
    half = box(50.0)
    assert (half.tracking_margin, half.confidence) == (5.0, 0.0)
    thesis, _ = create_campaign(tmp_path / "thesis", "quadrotor", "thesis")
    assert constraints_now(thesis, State()).margins == {}
