"""The same motion again is said to be so, and is no new group; another one is neither."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_robot import ALONE, make_campaign, random_motion, stub_learner, write_log

from etude import ask, status, tell
from etude.campaign import (
    Asked,
    Campaign,
    Exported,
    IngestResult,
    ingested_samples,
    open_campaign,
    stored_trajectory,
)
from etude.campaign.ingest.tell import CHECK, planned_states, share_within
from etude.campaign.training import _scores
from etude.logs import read_log_file
from etude.protocols import Trajectory
from etude.trajectories import from_json

pytestmark = pytest.mark.as_logged

QUICK = "[design]\nfirst = 'random'\ncandidates = 4\nrefine = 0\npoints = 20\nreference_points = 30\n"
CONFIG = "[trajectory]\nduration = 12.0\n[data]\ncutoff_hz = 5.0\n" + QUICK + ALONE


def asked_and_run(campaign: Campaign, folder: Path, motion: Trajectory | None = None) -> IngestResult:
    """The log of the next proposal; of `motion` in its place, as if that had been proposed."""
    number = ask(campaign, new=True, go_on=True).number
    file = campaign.proposal(number) / "trajectory.json"
    if motion is not None:
        file.write_text(motion.to_json())
        campaign.commit(Exported(), number, [file])
    trajectory = from_json(file.read_bytes())
    return tell(
        campaign,
        write_log(folder / f"{number}.csv", trajectory, seed=number),
        number=number,
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    asked_and_run(make_campaign(folder, config=CONFIG), folder)
    return folder


@pytest.fixture
def told_once(whole: Path, tmp_path: Path) -> tuple[Campaign, Trajectory]:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    campaign = open_campaign(tmp_path / "lab")
    return campaign, stored_trajectory(campaign, 1)


def repeats(told: IngestResult) -> list[str]:
    return [finding.sentence for finding in told.findings if finding.check == CHECK]


@pytest.mark.slow
def test_the_same_motion_again_is_no_new_group(
    told_once: tuple[Campaign, Trajectory], tmp_path: Path
) -> None:
    campaign, motion = told_once
    (sentence,) = repeats(asked_and_run(campaign, tmp_path, motion))
    assert sentence.startswith("it repeats log 1: 100 %")
    assert campaign.state().rounds[2].ingested.repeats == 1  # type: ignore[union-attr]
    assert f"log 2: {sentence}" in [news["sentence"] for news in status(campaign)["alerts"]]
    assert repeats(asked_and_run(campaign, tmp_path, random_motion(campaign, 7))) == []
    samples = ingested_samples(campaign, [1, 2, 3])
    assert np.unique(samples.group).tolist() == [0, 1]
    assert np.count_nonzero(samples.group == 0) > 1.9 * np.count_nonzero(samples.group == 1)
    # without the log that it repeats it stands for itself
    assert np.unique(ingested_samples(campaign, [2, 3]).group).tolist() == [0, 1]
    # nothing of it is new to a model of the first
    alone = ingested_samples(campaign, [1, 2])
    assert _scores(None, None, alone, 1) == {}  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_slower_run_of_it_is_another_motion(told_once: tuple[Campaign, Trajectory], tmp_path: Path) -> None:
    campaign, motion = told_once
    assert repeats(asked_and_run(campaign, tmp_path, motion.slowed(2.0))) == []


def test_most_of_it_is_enough_and_half_is_not(told_once: tuple[Campaign, Trajectory]) -> None:
    campaign, _ = told_once
    log = read_log_file(campaign.run_file(1))
    known = planned_states(campaign, log)
    assert known is not None
    assert share_within(known, known) == 1.0
    far = known.copy()
    far[: len(far) // 2, 0] += 100.0
    assert share_within(far, known) == pytest.approx(0.5, abs=0.02)
    edge = known + 0.999 * np.eye(known.shape[1])[1]
    assert share_within(edge, known) == 1.0
    assert share_within(known[:0], known) == share_within(known, known[:0]) == 0.0
    bare = log.without(*(name for name in log.values if name.endswith("_des")))
    assert planned_states(campaign, bare) is None


def test_choice_is_read_from_the_newest_design(told_once: tuple[Campaign, Trajectory]) -> None:
    campaign, _ = told_once
    state = campaign.state()
    from etude.campaign.evaluate.status import _variance_saved_by_design

    one = replace(state.rounds[1], asked=Asked(status="", learned=1, choice=0.3))
    before = replace(state.rounds[1], number=2, asked=Asked(status="", choice=0.9))
    none = replace(state.rounds[1], number=3, asked=Asked(status="", learned=2))
    assert _variance_saved_by_design(replace(state, rounds={1: one, 2: before, 3: none})) == 0.3


def test_a_damaged_earlier_log_does_not_keep_one_from_being_told(
    told_once: tuple[Campaign, Trajectory], tmp_path: Path
) -> None:
    campaign, _ = told_once
    number = ask(campaign, new=True, go_on=True).number
    log = write_log(tmp_path / "2.csv", stored_trajectory(campaign, number), seed=2)
    campaign.run_file(1).write_bytes(b"PAR1")
    assert not repeats(tell(campaign, log, number=number, learner=stub_learner))
    assert campaign.state().rounds[2].ingested is not None
