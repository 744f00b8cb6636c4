"""Asking and telling: idempotent, in any order, and the same after a replay as live."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from small_robot import ROBOT, SHORT, make_campaign, random_motion, stub_learner, write_log

from etude import ask, tell
from etude.campaign import (
    Asked,
    Campaign,
    IngestResult,
    abandon,
    create_campaign,
    inspect,
    open_campaign,
    stored_trajectory,
)
from etude.campaign.record.journal import damaged_files
from etude.errors import DataError, UnsafeTrajectoryError, UsageError
from etude.limits import certify

pytestmark = pytest.mark.as_logged


def told(campaign: Campaign, log: Path, **options: object) -> IngestResult:
    return tell(campaign, log, learner=stub_learner, **options)  # type: ignore[arg-type]


def asked(campaign: Campaign, count: int) -> list[int]:
    """Asks for several at once; nothing is learned, so no design is needed."""
    return [ask(campaign, new=True, learner=stub_learner).number for _ in range(count)]


def log_of(campaign: Campaign, number: int, folder: Path, speed: int = 100) -> Path:
    return write_log(folder / f"run{number}.csv", stored_trajectory(campaign, number, speed), number)


class TestInit:
    def test_the_folder_needs_nothing_outside(self, campaign: Campaign, tmp_path: Path) -> None:
        (tmp_path / "pair.toml").unlink()
        moved = tmp_path / "elsewhere"
        shutil.move(campaign.path, moved)
        assert open_campaign(moved).spec.names == ("hip", "knee")

    def test_a_built_in_robot_is_copied_with_its_model(self, tmp_path: Path) -> None:
        campaign, confirm = create_campaign(tmp_path / "lab", "arm4", seed=3)
        assert confirm == ()
        assert campaign.spec.model_file is not None
        assert campaign.spec.model_file.parent == campaign.path.resolve()
        assert campaign.state().seed == campaign.config.seed == 3
        assert damaged_files(campaign.path, campaign.events()) == []

    def test_a_second_one_is_refused(self, campaign: Campaign, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="already holds a campaign"):
            create_campaign(campaign.path, "arm4")

    def test_an_unknown_robot_makes_no_folder(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="nobody"):
            create_campaign(tmp_path / "lab", "nobody")
        assert not (tmp_path / "lab").exists()

    @pytest.mark.parametrize(
        ("old", "new"),
        [("lower = -1.0", "lower = 2.0"), ("velocity = 1.0", "velocity = 0"), ("rate", "ratte")],
    )
    def test_robot_limits_edited_into_nonsense(self, campaign: Campaign, old: str, new: str) -> None:
        path = campaign.path / "robot.toml"
        path.write_text(path.read_text().replace(old, new, 1))
        with pytest.raises(UsageError, match=r"robot\.toml"):
            open_campaign(campaign.path)


class TestAsk:
    def test_the_first_is_random_and_certified(self, campaign: Campaign) -> None:
        proposal = ask(campaign)
        assert (proposal.number, proposal.new) == (1, True)
        names = sorted(p.name for p in proposal.folder.iterdir())
        assert names == ["certificate.json", "trajectory.csv", "trajectory.json"]
        assert certify(stored_trajectory(campaign, 1), campaign.limits()).ok
        assert json.loads((proposal.folder / "certificate.json").read_text())["ok"] is True

    def test_asking_twice_returns_the_open_one(self, campaign: Campaign) -> None:
        first = ask(campaign)
        again = ask(campaign)
        assert (again.number, again.new) == (1, False)
        assert again.certificate == first.certificate
        assert len(campaign.events()) == 2

    def test_asking_for_a_new_one(self, campaign: Campaign) -> None:
        assert asked(campaign, 3) == [1, 2, 3]
        assert stored_trajectory(campaign, 1) != stored_trajectory(campaign, 2)

    def test_the_same_seed_asks_the_same(self, campaign: Campaign, tmp_path: Path) -> None:
        other = make_campaign(tmp_path / "other")
        third = make_campaign(tmp_path / "third", seed=6)
        for c in (campaign, other, third):
            ask(c)
        one, two, three = (stored_trajectory(c, 1) for c in (campaign, other, third))
        assert one == two
        assert one != three

    def test_a_slower_copy_is_certified_too(self, campaign: Campaign) -> None:
        proposal = ask(campaign, speed=25)
        assert proposal.folder.name == "speed_025"
        assert proposal.duration == 4 * stored_trajectory(campaign, 1).duration
        assert ask(campaign, speed=25).number == 1
        assert [e.event for e in campaign.events()] == ["created", "asked", "exported"]

    @pytest.mark.thinned
    @pytest.mark.parametrize("name", ["trajectory.json", "trajectory.csv", "certificate.json"])
    @pytest.mark.parametrize("speed", [100, 25])
    @pytest.mark.parametrize("harm", ["missing", "changed"])
    def test_a_damaged_file_of_an_open_proposal(
        self, campaign: Campaign, name: str, speed: int, harm: str
    ) -> None:
        path = ask(campaign, speed=speed).folder / name
        good, before = path.read_bytes(), campaign.events()
        if harm == "missing":
            path.unlink()
        else:
            path.write_bytes(good.replace(b"1", b"2", 1))
        with pytest.raises(UsageError) as caught:
            ask(campaign, speed=speed)
        assert (
            f"{path.relative_to(campaign.path)} {'is missing' if harm == 'missing' else 'was changed'}"
            in (caught.value.fact)
        )
        assert f"etude abandon {campaign.path} 1, then etude ask" in caught.value.next_step
        assert campaign.events() == before
        path.write_bytes(good)
        assert ask(campaign, speed=speed).number == 1

    def test_a_slower_copy_of_a_changed_trajectory(self, campaign: Campaign) -> None:
        path = ask(campaign).folder / "trajectory.json"
        path.write_bytes(path.read_bytes().replace(b"1", b"2", 1))
        with pytest.raises(UsageError, match=r"trajectory\.json was changed"):
            ask(campaign, speed=50)
        assert not (path.parent / "speed_050").exists()

    def test_after_the_advice_asking_goes_on(self, campaign: Campaign) -> None:
        (ask(campaign).folder / "trajectory.csv").unlink()
        abandon(campaign, 1)
        assert ask(campaign).number == 2

    def test_a_slower_copy_that_was_never_committed_is_written_again(self, campaign: Campaign) -> None:
        """Its writer was killed before the journal's line."""
        left = ask(campaign).folder / "speed_025"
        left.mkdir()
        (left / "trajectory.json").write_text("half")
        ask(campaign, speed=25)
        assert [e.event for e in campaign.events()] == ["created", "asked", "exported"]
        assert damaged_files(campaign.path, campaign.events()) == []

    def test_no_room_means_no_file(self, tmp_path: Path) -> None:
        text = ROBOT.replace("lower = -1.0", "lower = 0.9999999999999999")
        campaign = make_campaign(tmp_path)
        (campaign.path / "robot.toml").write_text(text)
        with pytest.raises((UnsafeTrajectoryError, UsageError)):
            ask(open_campaign(campaign.path))
        assert not list((campaign.path / "proposals").glob("*"))

    def test_an_uncertified_design_is_not_written(
        self, campaign: Campaign, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        import dataclasses

        def reckless(*args: object) -> object:
            good: Any = random_motion(campaign, 0)
            return dataclasses.replace(good, coefficients=2.0 * good.coefficients), Asked(status="")

        monkeypatch.setattr("etude.campaign.propose.ask.proposed", reckless)
        with pytest.raises(UnsafeTrajectoryError):
            ask(campaign)
        assert not (campaign.path / "proposals").exists()
        assert campaign.state().next_number == 1


class TestTell:
    def test_a_log_answers_its_proposal(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 1)
        result = told(campaign, log_of(campaign, 1, tmp_path))
        assert (result.number, result.repeated, result.foreign, result.learned) == (1, False, False, (1,))
        state = campaign.state()
        assert state.rounds[1].trained is not None
        assert state.rounds[1].ingested is not None
        assert abs(state.rounds[1].ingested.robot_seconds - 8.5) < 0.1
        source = (campaign.path / "runs" / "0001.source.toml").read_text()
        assert str(tmp_path / "run1.csv") in source
        assert damaged_files(campaign.path, campaign.events()) == []

    def test_the_same_log_under_another_name(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 2)
        log = log_of(campaign, 1, tmp_path)
        told(campaign, log)
        before = campaign.events()
        renamed = log.rename(tmp_path / "other name.csv")
        result = told(campaign, renamed)
        assert (result.number, result.repeated) == (1, True)
        assert campaign.events() == before
        with pytest.raises(UsageError, match="answer to trajectory 1, not 2"):
            told(campaign, renamed, number=2)

    def test_out_of_order(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 3)
        for number in (3, 1, 2):
            assert told(campaign, log_of(campaign, number, tmp_path)).number == number
        assert [r.number for r in campaign.state().trained] == [3, 1, 2]

    def test_a_log_of_another_trajectory_is_refused(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 1)
        log = write_log(tmp_path / "other.csv", random_motion(campaign, 99))
        before = campaign.events()
        with pytest.raises(DataError, match=r"not the log of the proposed.*--foreign"):
            told(campaign, log)
        with pytest.raises(DataError, match="not the log of the proposed"):
            told(campaign, log, number=1)
        assert campaign.events() == before
        assert not (campaign.path / "runs").exists()
        result = told(campaign, log, foreign=True)
        assert (result.number, result.foreign) == (2, True)
        assert [r.number for r in campaign.state().proposals] == [1]

    def test_inspect_says_which_proposal_a_log_answers(self, campaign: Campaign, tmp_path: Path) -> None:
        own = write_log(tmp_path / "first.csv", random_motion(campaign, 99))
        assert "proposal" not in {f.check for f in inspect(own, campaign.path).findings}
        asked(campaign, 2)
        found = inspect(log_of(campaign, 1, tmp_path), campaign.path)
        assert found.findings[-1].sentence == "The motion is that of proposal 1."
        assert not found.refused
        other = inspect(own, campaign.path)
        assert other.refused
        assert other.findings[-1].check == "proposal"
        assert "--foreign" in other.findings[-1].step
        assert not campaign.state().ingested
        told(campaign, log_of(campaign, 1, tmp_path))
        again = inspect(log_of(campaign, 1, tmp_path), campaign.path)
        assert not again.refused
        assert again.findings[-1].sentence == "This log was ingested before, as 1."

    def test_a_foreign_log_starts_a_campaign(self, campaign: Campaign, tmp_path: Path) -> None:
        result = told(campaign, write_log(tmp_path / "old.csv", random_motion(campaign, 1)))
        assert (result.number, result.foreign, result.learned) == (1, True, (1,))

    def test_a_slow_run_is_recognised(self, campaign: Campaign, tmp_path: Path) -> None:
        ask(campaign, speed=50)
        assert told(campaign, log_of(campaign, 1, tmp_path, speed=50)).number == 1
        assert campaign.state().rounds[1].ingested.speed == 50

    def test_numbers_that_cannot_be(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 1)
        log = log_of(campaign, 1, tmp_path)
        with pytest.raises(UsageError, match=r"there is no trajectory 4.*Asked for: 1"):
            told(campaign, log, number=4)
        told(campaign, log)
        with pytest.raises(UsageError, match="trajectory 1 has a log already"):
            told(campaign, write_log(tmp_path / "b.csv", stored_trajectory(campaign, 1), 77), number=1)

    @pytest.mark.parametrize(
        "content", [b"", b"time,q_hip\n", b"\x00\x01\x02" * 500, b"%PDF-1.4\n" * 100, b"time;q\n1;2\n" * 60]
    )
    def test_files_that_are_no_logs(self, campaign: Campaign, tmp_path: Path, content: bytes) -> None:
        asked(campaign, 1)
        path = tmp_path / "bad.csv"
        path.write_bytes(content)
        before = campaign.events()
        with pytest.raises(DataError):
            told(campaign, path)
        assert campaign.events() == before
        assert not (campaign.path / "runs").exists()

    def test_a_missing_file_and_an_unknown_kind(self, campaign: Campaign, tmp_path: Path) -> None:
        with pytest.raises(DataError, match="no such log file"):
            told(campaign, tmp_path / "nothing.csv")
        (tmp_path / "log.docx").write_bytes(b"x")
        with pytest.raises(DataError, match="no reader"):
            told(campaign, tmp_path / "log.docx")

    def test_an_unlearnable_log_waits_for_the_next(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 2)

        def picky(c: Campaign, state: object, number: int) -> object:
            if number == 1:
                raise DataError("axis hip never moved")
            return stub_learner(c, state, number)  # type: ignore[arg-type]

        with pytest.raises(DataError, match="never moved"):
            tell(campaign, log_of(campaign, 1, tmp_path), learner=picky)  # type: ignore[arg-type]
        assert [r.number for r in campaign.state().pending] == [1]
        result = tell(campaign, log_of(campaign, 2, tmp_path), learner=picky)  # type: ignore[arg-type]
        assert result.learned == (1, 2)
        assert [r.number for r in campaign.state().learned] == [1, 2]

    def test_asking_finishes_interrupted_learning(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 2)

        def killed(*_: object) -> object:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            tell(campaign, log_of(campaign, 1, tmp_path), learner=killed)  # type: ignore[arg-type]
        assert [r.number for r in campaign.state().pending] == [1]
        assert ask(campaign, learner=stub_learner).number == 2
        assert campaign.state().pending == []


class TestAbandon:
    def test_an_open_proposal(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 1)
        log = log_of(campaign, 1, tmp_path)
        assert abandon(campaign, 1)
        assert not abandon(campaign, 1)
        assert campaign.state().proposals == []
        assert asked(campaign, 1) == [2]
        assert told(campaign, log).number == 1

    def test_a_learned_log_is_unlearned(self, campaign: Campaign, tmp_path: Path) -> None:
        asked(campaign, 3)
        for number in (1, 2, 3):
            told(campaign, log_of(campaign, number, tmp_path))
        assert abandon(campaign, 2, learner=stub_learner)
        state = campaign.state()
        assert [r.number for r in state.trained] == [1, 3]
        assert json.loads((campaign.model_folder(3) / "model.json").read_text()) == {"logs": [1, 3]}

    def test_a_number_nobody_knows(self, campaign: Campaign) -> None:
        with pytest.raises(UsageError, match="no trajectory 9"):
            abandon(campaign, 9)


def test_replay_is_live(campaign: Campaign, tmp_path: Path) -> None:
    """A copy of the folder, opened fresh, goes on exactly as the original."""
    asked(campaign, 2)
    told(campaign, log_of(campaign, 2, tmp_path))
    copy = tmp_path / "copy"
    shutil.copytree(campaign.path, copy)
    other = open_campaign(copy)
    assert other.state() == campaign.state()
    for c in (campaign, other):
        told(c, log_of(campaign, 1, tmp_path))
    a, b = ([(e.event, e.number, e.files, e.fact) for e in c.events()] for c in (campaign, other))
    assert a == b


REST_S = 1.0
"""s that the pair's logs begin before their motion."""


@pytest.mark.parametrize(("part", "answered"), [(0.45, False), (0.55, True)])
def test_a_log_that_ends_early_teaches_and_answers_from_half_on(
    part: float, answered: bool, tmp_path: Path
) -> None:
    campaign = make_campaign(tmp_path, config=SHORT.replace("duration = 8.0", "duration = 12.0"))
    number = ask(campaign).number
    motion = stored_trajectory(campaign, number)
    lines = write_log(tmp_path / "whole.csv", motion, number).read_text().splitlines()
    kept = 2 + round((REST_S + part * motion.duration) * 50.0)
    (tmp_path / "cut.csv").write_text("\n".join(lines[:kept]) + "\n")
    told = tell(campaign, tmp_path / "cut.csv", learner=stub_learner)
    (said,) = [s for s in told.repairs if "ends at" in s]
    assert float(said.split()[11]) == pytest.approx((1.0 - part) * motion.duration, abs=0.15)
    assert told.foreign == (not answered)
    assert campaign.round(number).open == (not answered)
    assert told.learned == (told.number,)
    assert any("stays open" in s for s in told.repairs) == (not answered)
    if not answered:
        assert told.number != number
        whole = tell(campaign, tmp_path / "whole.csv", learner=stub_learner)
        assert (whole.number, whole.foreign) == (number, False)
