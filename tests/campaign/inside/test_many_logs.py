"""Campaigns of many logs: a training, a tell and a status take no longer, and models do not fill the disk."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from small_robot import make_campaign, random_motion, stub_learner, write_log

from etude import status, tell, untell
from etude.campaign import Campaign, Round, State, TrainingOutcome, newest_model, open_campaign, replay
from etude.campaign.record import journal, stored_models
from etude.campaign.record.events import Ingested
from etude.campaign.training import MOST_LOGS, MOST_SECONDS, teaching
from etude.codes import Warn
from etude.errors import DataError, UsageError

pytestmark = pytest.mark.as_logged

CONFIG = """\
[trajectory]
duration = 8.0
[data]
cutoff_hz = 5.0
[model]
rung = "gp"
candidates = ["default"]
points = 60
inducing = 80
fit_points = 40
steps = 3
"""


def told(seconds: Sequence[float]) -> State:
    rounds = {
        n: Round(n, ingested=Ingested(source="log", sha256=str(n), robot_seconds=s))
        for n, s in enumerate(seconds, 1)
    }
    return State(rounds=rounds)


@pytest.mark.parametrize(("count", "seconds"), [(1000, 3.0), (150, 60.0), (3, 5000.0), (1, 9999.0)])
def test_logs_that_teach_are_bounded_and_spread_evenly(count: int, seconds: float) -> None:
    logs = list(range(1, count + 1))
    found = teaching(told([seconds] * count), logs)
    assert found[-1] == count, "the newest is one of them"
    assert found == sorted(set(found))
    assert len(found) <= MOST_LOGS
    assert len(found) == 1 or len(found) * seconds <= MOST_SECONDS
    gaps = [after - before for before, after in zip([0, *found], found, strict=False)]
    assert max(gaps) - min(gaps) <= 1


def test_few_logs_teach_all() -> None:
    assert teaching(told([60.0] * 20), list(range(1, 21))) == list(range(1, 21))


def logs_of(campaign: Campaign, folder: Path, numbers: Sequence[int]) -> list[Path]:
    return [write_log(folder / f"{n:05d}.csv", random_motion(campaign, n), n) for n in numbers]


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Five logs, learned one by one, of whose models two are kept."""
    folder = tmp_path_factory.mktemp("pruned")
    campaign = make_campaign(folder, config=CONFIG)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(journal, "KEPT_MODELS", 2)
        for path in logs_of(campaign, folder, range(1, 6)):
            tell(campaign, path)
    return campaign


def test_superseded_models_are_removed_and_nobody_misses_them(
    learned: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal, "KEPT_MODELS", 2)
    assert sorted(path.parent.name for path in learned.path.glob("models/*/model.npz")) == ["0004", "0005"]
    assert status(learned)["problems"] == []
    assert newest_model(learned, learned.state()).commands
    (learned.path / "models" / "0005" / "model.npz").rename(learned.path / "kept")
    try:
        assert len(status(learned)["problems"]) == 1, "the newest is missed"
        with pytest.raises(UsageError, match="missing"):
            newest_model(learned, learned.state())
    finally:
        (learned.path / "kept").rename(learned.path / "models" / "0005" / "model.npz")


def test_a_log_is_taken_back_though_the_model_before_it_was_removed(
    learned: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal, "KEPT_MODELS", 2)
    shutil.copytree(learned.path, tmp_path / "lab")
    campaign = open_campaign(tmp_path / "lab")
    assert untell(campaign, 2)
    state = campaign.state()
    assert state.newest is not None
    assert state.newest.logs == (1, 3, 4, 5)
    assert newest_model(campaign, state).commands
    assert status(campaign)["problems"] == []


def test_a_stored_log_is_read_once_and_its_file_checked_each_time(
    learned: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(learned.path, tmp_path / "lab")
    campaign = open_campaign(tmp_path / "lab")
    first = stored_models.stored_log(campaign, 1)
    assert stored_models.stored_log(campaign, 1) is first
    monkeypatch.setattr(stored_models, "KEPT_LOGS", 1)
    other = stored_models.stored_log(campaign, 2)
    assert stored_models.stored_log(campaign, 2) is not other, "beyond what is kept, it is read again"
    campaign.run_file(1).write_bytes(campaign.run_file(2).read_bytes())
    with pytest.raises(UsageError, match="0001"):
        stored_models.stored_log(campaign, 1)


def test_a_state_is_that_of_all_events_whoever_wrote_them(learned: Campaign, tmp_path: Path) -> None:
    shutil.copytree(learned.path, tmp_path / "lab")
    here, there = open_campaign(tmp_path / "lab"), open_campaign(tmp_path / "lab")
    short = (tmp_path / "lab" / "journal.jsonl").read_bytes()
    for number in (5, 4):
        assert here.state() == replay(here.events())
        untell(there, number, learner=stub_learner)
    assert here.state() == replay(here.events()) == there.state()
    (tmp_path / "lab" / "journal.jsonl").write_bytes(short)
    assert here.state() == replay(here.events()) == learned.state(), "and of a journal that was put back"


def counted_tell(campaign: Campaign, path: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Stored logs that a tell reads."""
    read, whole = [], stored_models.require_runs
    monkeypatch.setattr(
        stored_models, "require_runs", lambda lab, numbers: read.extend(numbers) or whole(lab, numbers)
    )
    assert tell(campaign, path).learned
    monkeypatch.undo()
    return len(read)


def unlearned(campaign: Campaign, state: State, number: int) -> TrainingOutcome:
    raise DataError("later")


@pytest.mark.slow
def test_a_thousand_logs_cost_a_tell_no_more_than_a_hundred(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Work is counted: logs that are read, logs that teach, lines of the journal that are read anew."""
    campaign = make_campaign(tmp_path, config=CONFIG.replace("duration = 8.0", "duration = 4.0"))
    read, taught = {}, {}
    for first, last in ((1, 110), (112, 999)):
        with pytest.raises(DataError, match="later"):
            tell(campaign, logs_of(campaign, tmp_path, range(first, last)), learner=unlearned)
        tell(campaign, logs_of(campaign, tmp_path, [last]))  # with all that wait
        read[last] = counted_tell(campaign, *logs_of(campaign, tmp_path, [last + 1]), monkeypatch)
        newest = campaign.state().newest
        assert newest is not None
        taught[last] = len(newest.logs)
        assert any(one.code == Warn.SOME_TEACH for one in newest.warnings)
    assert read[999] <= 1.2 * read[110]
    assert taught == {110: MOST_LOGS, 999: MOST_LOGS}
    parsed = journal._event.cache_info().misses
    assert status(campaign)["problems"] == []
    assert journal._event.cache_info().misses == parsed, "no line is read twice"
