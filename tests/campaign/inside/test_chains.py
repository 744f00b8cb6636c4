"""Recordings of several segments: asked, run, told and learned; the first without any log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_robot import make_campaign, random_motion, stub_learner, write_log

from certificate_schema import valid
from etude import ask, tell
from etude.campaign import Campaign, ingested_samples, stored_trajectory
from etude.campaign.propose.typical_motions import reference_motions, segments_of
from etude.limits import certify_bytes
from etude.protocols import Trajectory
from etude.trajectories import Chain

pytestmark = pytest.mark.as_logged

QUICK = "[design]\ncandidates = 4\nrefine = 1\nsteps = 3\npoints = 20\nreference_points = 30\n"
LONG = "[trajectory]\nduration = 30.0\n[data]\ncutoff_hz = 5.0\n" + QUICK
RANDOM = LONG.replace("[design]\n", '[design]\nfirst = "random"\n')


def chain_of(campaign: Campaign, number: int = 1, speed: int = 100) -> Chain:
    found = stored_trajectory(campaign, number, speed)
    assert isinstance(found, Chain)
    return found


@pytest.fixture
def long(tmp_path: Path) -> Campaign:
    return make_campaign(tmp_path, config=LONG)


@pytest.mark.parametrize("config", [LONG, RANDOM], ids=["designed", "random"])
def test_a_recording_is_filled_with_different_segments(tmp_path: Path, config: str) -> None:
    long = make_campaign(tmp_path, config=config)
    proposal = ask(long)
    pieces = chain_of(long).pieces()
    assert [label for _, label, _ in pieces] == ["segment", "link", "segment"]
    first, _, second = (piece for _, _, piece in pieces)
    assert first.duration == second.duration == 15.0
    table = [piece.coefficients for piece in (first, second)]  # type: ignore[attr-defined]
    assert np.abs(table[0] - table[1]).max() > 0.05
    assert all(piece.omega0 == pytest.approx(2 * np.pi / 15.0) for piece in (first, second))  # type: ignore[attr-defined]
    assert proposal.certificate.ok
    data = (proposal.folder / "trajectory.json").read_bytes()
    rows = valid((proposal.folder / "certificate.json").read_bytes())["rows"]
    proved = certify_bytes(data, long.limits()).rows
    assert [row["proved_upper"] for row in rows] == [row.proved_upper for row in proved]
    assert all("segment at" in row.where or "link at" in row.where for row in proved)


def test_the_first_is_designed_from_the_limits_alone(long: Campaign, tmp_path: Path) -> None:
    ask(long)
    facts = long.state().rounds[1].asked
    assert facts is not None
    assert facts.status.startswith("from the limits alone: 2 segments")
    assert facts.gain is None
    assert facts.learned == 0
    assert facts.value >= facts.baseline_value
    again = make_campaign(tmp_path / "again", config=LONG)
    ask(again)
    assert chain_of(again).to_json() == chain_of(long).to_json()


def test_what_waits_for_its_log_is_not_asked_for_again(long: Campaign, tmp_path: Path) -> None:
    ask(long)
    ask(long, new=True)
    facts = [long.state().rounds[number].asked for number in (1, 2)]
    # both have the measure of the limits alone, and the second is given the first
    assert facts[0] is not None
    assert facts[1] is not None
    assert facts[1].value > facts[0].value
    apart = make_campaign(tmp_path / "alone", seed=long.state().seed, config=LONG)
    (apart.path / "proposals").mkdir()
    assert chain_of(long, 2).to_json() != chain_of(long, 1).to_json()


def test_each_segment_is_a_group(long: Campaign, tmp_path: Path) -> None:
    ask(long)
    chain = chain_of(long)
    told = tell(long, write_log(tmp_path / "one.csv", chain), learner=stub_learner)
    assert (told.number, told.foreign) == (1, False)
    facts = long.state().rounds[1].ingested
    assert facts is not None
    starts = [start for start, label, _ in chain.pieces() if label == "segment"]
    assert list(facts.segments) == list(starts)
    # a log of no proposal is one group
    tell(long, write_log(tmp_path / "two.csv", random_motion(long, 3)), foreign=True, learner=stub_learner)
    samples = ingested_samples(long, [1, 2])
    assert np.unique(samples.group).tolist() == [0, 1, 2]
    second = samples.t[samples.group == 1]
    assert second.min() >= starts[1]
    assert samples.t[samples.group == 0].max() <= starts[1]
    assert len(second) > 100


def test_at_half_speed_segments_start_later(long: Campaign, tmp_path: Path) -> None:
    ask(long, speed=50)
    slow = chain_of(long, speed=50)
    told = tell(long, write_log(tmp_path / "slow.csv", slow), learner=stub_learner)
    facts = long.state().rounds[told.number].ingested
    assert facts is not None
    assert facts.speed == 50
    assert facts.segments[1] == pytest.approx(2.0 * chain_of(long).pieces()[2][0])


def test_a_log_that_breaks_off_in_the_second_segment_is_still_aligned(long: Campaign, tmp_path: Path) -> None:
    ask(long)
    path = write_log(tmp_path / "part.csv", chain_of(long))
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[: 1 + round(0.75 * len(lines))]) + "\n")
    told = tell(long, path, learner=stub_learner)
    assert not told.foreign
    assert np.unique(ingested_samples(long, [1]).group).tolist() == [0, 1]


def test_what_stands_in_for_tasks_are_moves_and_series(long: Campaign) -> None:
    found: list[Trajectory] = reference_motions(long, np.random.default_rng(0))
    assert sorted({motion.form for motion in found}) == ["fourier", "moves"]
    assert [motion.form for motion in found].count("moves") == len(found) / 2 >= 6


def test_a_recording_too_short_for_two_is_one_segment(tmp_path: Path) -> None:
    for duration, count, segment in ((12.0, 1, 12.0), (19.0, 1, 19.0), (31.0, 2, 15.5), (47.0, 3, 47.0 / 3)):
        campaign = make_campaign(tmp_path / str(duration), config=f"[trajectory]\nduration = {duration}\n")
        family = campaign.kind.family(campaign.spec, campaign.config)
        assert segments_of(campaign, family) == count
        assert family.trajectory(np.zeros(family.size)).duration == pytest.approx(segment)
