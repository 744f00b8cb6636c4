"""A robot closes the loop: what moves is in the journal first, what it left answers its proposal, and
whatever goes wrong leaves it at rest.
"""

from __future__ import annotations

import base64
import json
import re
import shlex
import shutil
import signal
from collections import namedtuple
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from robot_runs import JOINTS, QUICK, Robot, Somebody, events, facts, home, lab, moved
from small_robot import make_campaign

import etude
from etude import cli, tell, untell
from etude.campaign import Campaign, Event, Trained, inspect, newest_model, open_campaign
from etude.campaign.ingest.ingest_result import read
from etude.campaign.ingest.recordings import Evidence, file_gravity, log_of, planned_log
from etude.campaign.ingest.robot_changed import answer
from etude.campaign.record.events import Ingested, MotionEnded, MotionSent, RunEnded
from etude.campaign.run import robot_session
from etude.campaign.run.campaign_run import MOST_AFTER_STOP, connected, learn
from etude.campaign.run.certified_motions import COMMAND_HZ, Learned, proposal_motion
from etude.campaign.run.next_proposal import NextProposal
from etude.campaign.run.preconditions import open_points
from etude.campaign.run.run_history import next_step, pending_recordings
from etude.campaign.run.run_settings import read_settings
from etude.drivers import (
    About,
    Sample,
    Streamed,
    VelocityEnvelope,
    find_driver,
    read_recording,
    write_recording,
)
from etude.errors import (
    DataError,
    EtudeError,
    RobotStopped,
    StopRuleReached,
    UnsafeTrajectoryError,
    UsageError,
)
from etude.logs import read_log_file
from etude.types import Array

pytestmark = pytest.mark.as_logged


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Robot, Any]:
    """Two motions, and the one that confirms."""
    campaign = lab(tmp_path_factory.mktemp("done"), 20.0)
    robot = Robot()
    robot.push[:] = -3.0  # what it has to hold at rest, too
    return campaign, robot, moved(campaign, robot, rounds=2, confirm=True, promote=True)


def test_what_moves_is_in_the_journal_first(done: tuple[Campaign, Robot, Any]) -> None:
    campaign, _, _ = done
    own = [e for e in events(campaign) if isinstance(e.fact, MotionSent | MotionEnded)]
    for sent, ended in zip(own[::2], own[1::2], strict=True):
        assert isinstance(sent.fact, MotionSent)
        assert isinstance(ended.fact, MotionEnded)
        assert (sent.number, sent.fact.sha256, sent.fact.part) == (
            ended.number,
            ended.fact.sha256,
            ended.fact.part,
        )
        assert ended.fact.ended == "done"
    assert facts(campaign, RunEnded)[-1].exit_code == 0


def test_its_own_recording_is_not_told_that_its_rate_is_another(
    done: tuple[Campaign, Robot, Any], tmp_path: Path
) -> None:
    own = Path(shutil.copytree(done[0].path, tmp_path / "lab"))
    text = (own / "robot.toml").read_text()
    (own / "robot.toml").write_text(text.replace("rate = 50", "rate = 100"))
    campaign, recording = open_campaign(own), next((own / "recordings").glob("0001.motion.*.parquet"))
    assert campaign.spec.rate == 2.0 * done[1].about().rate
    assert not any("rows a second" in sentence for sentence in read(campaign, recording).repairs)
    found = [one.check for one in inspect(recording, own).findings]
    assert "commands" in found or "units and ranges" in found, found
    assert "robot rate" not in found


def test_a_control_is_tried_slowly_before_a_whole_motion(done: tuple[Campaign, Robot, Any]) -> None:
    campaign, _, _ = done
    own = [e for e in events(campaign) if isinstance(e.fact, MotionEnded) and e.fact.part == "motion"]
    steps = [(e.number, e.fact.control, e.fact.speed, e.fact.first) for e in own]  # type: ignore[union-attr]
    one, two, confirming = steps[:-4], steps[-4:-2], steps[-2:]
    assert one[:2] == [(1, "feedback", 25, True), (1, "feedback", 50, True)]
    assert one[-1] == (1, "feedback", 100, False)
    assert two == [(2, "learned", 50, True), (2, "learned", 100, False)]
    ways = [one for one in facts(campaign, MotionEnded) if one.part == "approach"]
    assert [one.speed for one in ways][:2] == [25, 50]
    assert np.abs(read_recording(campaign.path / ways[0].recording).motion.qd).max() < 0.25
    assert confirming == [(3, "feedback", 100, False), (3, "learned", 100, False)]


def test_a_whole_motion_answers_its_proposal_at_its_own_times(done: tuple[Campaign, Robot, Any]) -> None:
    campaign, _, found = done
    one, two = facts(campaign, Ingested)
    assert (one.foreign, one.control, two.control) == (False, "feedback", "learned")
    assert [r.number for r in found.rounds] == [1, 2]
    assert len(facts(campaign, Trained)) == 2
    ended = [fact for fact in facts(campaign, MotionEnded) if fact.recording_sha256 == one.sha256]
    recording = read_recording(campaign.path / ended[0].recording)
    inside = (recording.t >= recording.began) & (recording.t <= recording.began + recording.reached)
    lag = np.abs(recording.q - recording.asked)[inside].max(axis=0)[[1, 0]]
    kept = np.array(next(iter(one.tracked.values())))[0]
    assert kept == pytest.approx(lag, rel=0.02), "no lag was absorbed, and joints are by name"


def test_a_path_that_lags_after_lost_cycles_is_no_error_of_the_robot(
    done: tuple[Campaign, Robot, Any],
) -> None:
    campaign, _, _ = done
    path = next(f.recording for f in facts(campaign, MotionEnded) if f.part == "motion" and not f.first)
    sound = read_recording(campaign.path / path)
    shift = np.where((sound.at > 5.0) & (sound.at < 8.0), 0.06, 0.0)
    late = replace(sound, at=sound.at - shift)
    evidence = Evidence(late, "feedback")
    log = planned_log(campaign, evidence, log_of(campaign, evidence, "late"))
    wanted = evidence.trajectory.motion(np.interp(log.t, late.t - late.began, late.at), 1).orders[0]
    inside = (log.t > 0.1) & (log.t < late.motion.duration - 0.1)
    np.testing.assert_allclose(log["q_des"][inside], wanted[inside], atol=1e-9)


def test_it_ends_at_home_and_the_learned_command_was_sent(done: tuple[Campaign, Robot, Any]) -> None:
    campaign, robot, found = done
    assert np.abs(robot.q[[1, 0]] - home(campaign)).max() < 1e-3
    assert robot.efforts[0] is None
    assert any(effort is not None for effort in robot.efforts)
    assert found.confirmed["number"] == 3
    assert found.robot_seconds > 60.0
    alone, learned = (np.mean(one.error) for one in found.rounds)
    assert learned < 0.6 * alone
    assert np.mean(found.confirmed["with"]) < 0.8 * np.mean(found.confirmed["without"])


def test_the_learned_command_comes_and_goes_without_a_step(done: tuple[Campaign, Robot, Any]) -> None:
    _, robot, _ = done
    sent = np.array([np.zeros(2) if effort is None else effort for effort in robot.efforts])
    assert np.abs(sent).max() > 0.5
    # masses of 1 kg: along a path the command steps as the accelerations of the set-points do
    accelerations = np.diff(np.array(robot.sent), 2, axis=0) * 50.0**2
    assert np.abs(np.diff(sent, axis=0)).max() < 1.1 * np.abs(np.diff(accelerations, axis=0)).max()


def test_ctrl_c_while_it_stands_lets_it_hold_first(tmp_path: Path) -> None:
    robot = Robot()
    with connected(lab(tmp_path), Streamed(robot), Somebody()):
        before = robot.stopped
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        assert robot.stopped == before + 1
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_recording_that_is_taken_back_is_told_again_as_it_was(done: tuple[Campaign, Robot, Any]) -> None:
    campaign, _, _ = done
    before = facts(campaign, Ingested)[1]
    path = next(f.recording for f in facts(campaign, MotionEnded) if f.recording_sha256 == before.sha256)
    untell(campaign, 2)
    told = tell(campaign, campaign.path / path)
    assert (told.number, told.foreign) == (2, False)
    assert facts(campaign, Ingested)[-1].tracked == before.tracked


HALF = np.array([1.0, 0.5])
BLOCKS: dict[str, tuple[Callable[[], Robot], str]] = {
    "command": (lambda: Robot(command_of=None), "does not state command_of"),
    "gravity": (lambda: Robot(gravity_in_command=None), "does not state gravity_in_command"),
    "joints": (lambda: Robot(("hip", "elbow")), "it lacks knee and it has elbow"),
    "unit": (lambda: Robot(command_unit="A"), "commands in A, but robot.toml states N m"),
    "velocity": (
        lambda: Robot(velocity=np.array([1.0, 0.5])),
        "velocity 0.5 of hip, but robot.toml allows 1",
    ),
    "lower": (lambda: Robot(lower=np.array([-1.4, -1.0])), "lower -1.4 of knee, but robot.toml allows -1.5"),
    "silence": (lambda: Robot(silence=0.5), "is regarded as lost after 0.5 s without a sample"),
    "glitches": (lambda: Robot(silence=0.03), "is regarded as lost after 0.03 s without a sample"),
    "rarely": (lambda: Robot(rate=4.0, silence=0.6), "sends 4 samples a second, too few to stop it in time"),
    "never": (lambda: Robot(rate=0.0), "sends 0 samples a second"),
    "nameless": (lambda: Robot(identity=""), "has no identity"),
}


@pytest.mark.parametrize("case", BLOCKS)
def test_what_is_open_blocks(tmp_path: Path, case: str) -> None:
    make, sentence = BLOCKS[case]
    robot, campaign = make(), lab(tmp_path)
    with pytest.raises(UsageError, match=sentence):
        moved(campaign, robot)
    assert robot.sent == []
    assert len(events(campaign)) == 1, "nothing was asked either"


ENVELOPE = VelocityEnvelope(
    most=np.array([2.0, 0.9]),
    offset=np.array([-0.1, 0.0]),
    slope=np.array([3.0, 2.0]),
    lower=np.array([-1.6, -1.0]),
    upper=np.array([0.6, 1.0]),
)


@pytest.mark.parametrize(
    ("says", "sentence"),
    [
        (
            {"jerk": np.array([1.0 / 3.0, 500.0])},
            "enforces jerk 500 of hip, but robot.toml has no such limit",
        ),
        ({"torque_rate": np.array([80.0, 1000.0])}, "enforces torque_rate 80 of knee"),
        ({"command": np.array([4.0, 1000.0])}, "enforces command 4 of knee"),
        ({"envelope": ENVELOPE}, r"velocity 0 at 1 of hip, but robot.toml allows 0\.9 there"),
        (
            {"envelope": ENVELOPE, "acceleration": np.array([1.5, 9.0])},
            r"velocity 0\.9 of hip, but .* allows 1",
        ),
    ],
)
def test_what_a_robot_enforces_is_written_as_the_lines_say(
    tmp_path: Path, says: dict[str, Any], sentence: str
) -> None:
    campaign, robot = lab(tmp_path), Robot(**says)
    with pytest.raises(UsageError, match=sentence) as refused:
        moved(campaign, robot)
    path = campaign.path / "robot.toml"
    _, _, lines = refused.value.next_step.removesuffix(".").partition("robot.toml: ")
    for own in lines.split("; "):
        axis, _, keys = own.partition(": ")
        text, ours = path.read_text(), re.split(r", (?=\w+ = )(?![^{]*})", keys)
        for key in ours:
            text = re.sub(rf'(name = "{axis}"(?:\n[^[\n].*)*)\n{key.split()[0]} = .*', r"\1", text)
        path.write_text(text.replace(f'name = "{axis}"', "\n".join([f'name = "{axis}"', *ours])))
    campaign = open_campaign(campaign.path)
    assert not open_points(campaign, robot.about(), resume=False, identity="")
    own = {"envelope": replace(ENVELOPE, slope=0.99 * ENVELOPE.slope)}
    closer = own if "envelope" in says else {name: 0.99 * value for name, value in says.items()}
    assert open_points(campaign, Robot(**{**says, **closer}).about(), resume=False, identity="")


def test_a_rate_of_the_command_counts_where_one_is_sent(tmp_path: Path) -> None:
    robot = Robot(torque_rate=np.array([80.0, 1000.0]), controls=("feedback",))
    assert not open_points(lab(tmp_path), robot.about(), resume=False, identity="")


def test_a_line_to_confirm_blocks_a_real_robot_alone(tmp_path: Path) -> None:
    campaign = lab(tmp_path)
    path = campaign.path / "robot.toml"
    path.write_text('confirm = ["No floor is assumed."]\n' + path.read_text())
    campaign, person = open_campaign(campaign.path), Somebody()
    with pytest.raises(UsageError, match="No floor is assumed"):
        moved(campaign, Robot(real=True))
    moved(campaign, Robot(), person, dry=True)
    assert moved(campaign, Robot(), dry=True).notes[-1].endswith("No floor is assumed.")


def test_nobody_agrees_for_a_real_robot(tmp_path: Path) -> None:
    campaign, robot = lab(tmp_path), Robot(real=True)
    with pytest.raises(UsageError, match="real"):
        moved(campaign, robot, yes=True)
    with pytest.raises(UsageError, match="the motion was not confirmed"):
        moved(campaign, robot, Somebody(word="yes"))
    assert robot.sent == []
    assert facts(campaign, MotionSent) == []


def test_a_dry_run_moves_nothing_and_says_what_would(tmp_path: Path) -> None:
    campaign, robot = lab(tmp_path), Robot()
    said = moved(campaign, robot, dry=True).notes
    assert robot.sent == []
    assert facts(campaign, MotionSent) == []
    assert any("the beginning of motion 1 at 25 %" in own for own in said)


def test_masses_that_allow_no_motion_are_waived_in_a_simulation(tmp_path: Path) -> None:
    campaign = weighing(tmp_path, effort=2.0)
    assert any("No motion is possible with the numbers" in line for line in campaign.spec.confirm)
    with pytest.raises(UnsafeTrajectoryError, match="No motion is possible with the numbers"):
        etude.ask(campaign)
    with pytest.raises(UsageError, match="No motion is possible with the numbers"):
        moved(campaign, Robot(("hip", "knee"), real=True), dry=True)
    found = moved(campaign, Robot(("hip", "knee")), dry=True)
    assert found.planned is not None
    assert any("No motion is possible with the numbers" in line for line in found.notes)


def test_a_dry_run_draws_the_way_from_where_the_robot_stands(tmp_path: Path) -> None:
    campaign = weighing(tmp_path)
    (tmp_path / "bot.py").write_text(BOT)
    text = f'[driver]\non = "{tmp_path}/bot.py:bot"\nrate = 50.0\nstart = [0.3, -0.2]\n'
    (campaign.path / "run.toml").write_text(text)
    assert cli.main(["run", str(campaign.path), "--dry-run"]) == 0
    page = (campaign.path / "view.html").read_text()
    assert "trajectory 1 with the approach from the current pose" in page
    shown = json.loads(page.split('type="application/json">')[1].partition("</script>")[0])
    assert [own["label"] for own in shown["pieces"]][:2] == ["approach", "segment"]
    q = np.frombuffer(base64.b64decode(shown["planned"]["q"]), "<f4").reshape(-1, 2)
    t, began = shown["step"] * np.arange(shown["count"]), shown["pieces"][1]["start"]
    np.testing.assert_allclose(q[0], [0.3, -0.2], atol=1e-4)
    whole = proposal_motion(campaign, 1, "feedback").trajectory
    exact = whole.motion(t[t >= began] - began, 1).orders[0]
    np.testing.assert_allclose(q[t >= began], exact, atol=1e-6)
    for moment in re.findall(r'data-time="([\d.]+)"', page):
        assert float(moment) >= began, "times of the certificate are the motion's own"


def test_a_person_agrees_to_where_the_whole_motion_goes(tmp_path: Path) -> None:
    campaign = lab(tmp_path, 20.0)
    said = moved(campaign, Robot(), dry=True).notes
    whole = proposal_motion(campaign, 1, "feedback").trajectory
    q = whole.motion(np.linspace(0.0, whole.duration, 500), 1).orders[0]
    ends = zip(campaign.axes, q.min(axis=0), q.max(axis=0), strict=True)
    ranges = [f"{axis} in {low:.2f}..{high:.2f}" for axis, low, high in ends]
    assert f"Motion 1 moves {', '.join(ranges)}." in said


def test_a_joint_that_sticks_is_stopped_and_the_next_run_is_slower(tmp_path: Path) -> None:
    campaign, robot = lab(tmp_path), Robot()

    def sticks(event: str, fields: Any) -> None:
        robot.blocked[0] = (event, fields.get("part"), fields.get("speed")) == ("motion_sent", "motion", 50)

    with pytest.raises(RobotStopped, match=r"stopped: .*knee is .* of the motion"):
        moved(campaign, robot, told=sticks)
    last = facts(campaign, MotionEnded)[-1]
    assert (last.ended, last.part) == ("stopped", "motion")
    assert facts(campaign, RunEnded)[-1].exit_code == RobotStopped.exit_code
    assert facts(campaign, Ingested) == []
    assert [r.number for r in campaign.state().proposals] == [1]
    steps = [fact for fact in facts(campaign, MotionEnded) if fact.part == "motion"]
    assert next_step(events(campaign), "feedback").speed < steps[-1].speed
    way = replace(steps[1], part="approach", ended="stopped")
    passed = [Event(fact) for fact in (steps[0], steps[0], way)]
    assert [next_step(passed[:n], "feedback").speed for n in (1, 2, 3)] == [50, 100, 50]
    robot.blocked[:] = False
    moved(campaign, robot)
    sent = [fact for fact in facts(campaign, MotionSent) if fact.part == "approach"][-2:]
    assert facts(campaign, Ingested)[0].control == "feedback"
    assert sent


class Weak(Robot):
    """Its commands end at this limit, N m, and one of its joints lags behind from a set-point on."""

    def state(self) -> Sample:
        sample = super().state()
        assert sample.command is not None
        return replace(sample, command=np.clip(sample.command, -self.most, self.most))

    most = np.inf


@pytest.mark.parametrize("part", [1.0, 0.5])
def test_a_command_at_its_limit_is_named_as_the_cause_of_a_stop(
    tmp_path: Path, part: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign, robot = lab(tmp_path), Weak()
    monkeypatch.setattr(robot_session, "file_gravity", lambda _, q: np.array([[0.5, 3.21]]) + 0.0 * q)
    robot.most = part * float(campaign.kind.limit(campaign.spec)[1])
    robot.at = {1: lambda: robot.blocked.__setitem__(0, True)}
    with pytest.raises(RobotStopped) as found:
        moved(campaign, robot)
    said = found.value.next_step
    assert ("command of knee was at its limit" in said) == (part == 1.0)
    assert ("; at rest there the model file expects 3.21 N m." in said) == (part == 1.0)
    assert "Remove the cause, then: etude run" in said
    assert (
        f"correct limits or home in robot.toml, and write another motion: etude ask {campaign.path} --new"
        in said
    )
    assert "With corrected masses begin anew: etude init" in said, "a campaign refuses another model file"


def test_a_whole_motion_that_was_stopped_is_given_up_and_another_asked_for(tmp_path: Path) -> None:
    campaign, robot = lab(tmp_path), Robot()

    def hangs(event: str, fields: Any) -> None:
        if event == "motion_sent" and fields["part"] == "motion" and not fields["first"]:
            robot.at = {len(robot.sent) + 160: lambda: robot.blocked.__setitem__(1, True)}

    with pytest.raises(RobotStopped, match="hip"):
        moved(campaign, robot, told=hangs)
    fact = facts(campaign, Ingested)[0]
    assert fact.foreign
    assert fact.robot_seconds == pytest.approx(3.2, abs=0.5)
    assert campaign.state().proposals == []
    robot.blocked[:] = False
    moved(campaign, robot)
    assert [one.foreign for one in facts(campaign, Ingested)] == [True, False]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("budget", "undecided", "motions"), [(20, 2, 3), (20, 9, 1 + MOST_AFTER_STOP), (1, 9, 1)]
)
def test_it_goes_on_after_the_stop_rule_while_the_model_is_undecided(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, budget: int, undecided: int, motions: int
) -> None:
    campaign = make_campaign(tmp_path, config=f"{QUICK}[stop]\nbudget_trajectories = {budget}\n")

    def fired(_: NextProposal) -> int:
        learn(campaign, print)
        raise StopRuleReached("the stop rule fired")

    monkeypatch.setattr(NextProposal, "number", fired)
    left = iter([True] * undecided)
    monkeypatch.setattr("etude.campaign.run.campaign_run.is_undecided", lambda _: next(left, False))
    found = moved(campaign, Robot(), rounds=0, promote=True)
    assert len(found.rounds) == motions
    assert found.why == "the stop rule fired"


def test_a_stopped_motion_teaches_up_to_the_stop_and_answers_nothing(tmp_path: Path) -> None:
    campaign, robot = lab(tmp_path), Robot()
    person = Somebody()

    def whole_motion(event: str, fields: Any) -> None:
        if event == "motion_sent" and fields["part"] == "motion" and not fields["first"]:
            person.left = 150

    with pytest.raises(KeyboardInterrupt):
        moved(campaign, robot, person, whole_motion)
    last = facts(campaign, MotionEnded)[-1]
    assert (last.ended, last.speed, last.first) == ("interrupted", 100, False)
    told = tell(campaign, campaign.path / last.recording)
    fact = facts(campaign, Ingested)[0]
    assert (told.foreign, told.number) == (True, 2)
    assert fact.robot_seconds == pytest.approx(last.reached, abs=0.6)
    assert any("the log is used up to there" in own for own in fact.repairs)
    assert [r.number for r in campaign.state().proposals] == [1]


def test_a_person_who_lets_go_stops_it_and_nothing_is_told(tmp_path: Path) -> None:
    campaign, robot = lab(tmp_path), Robot()
    with pytest.raises(KeyboardInterrupt):
        moved(campaign, robot, Somebody(lets_go_after=60))
    assert facts(campaign, MotionEnded)[-1].ended == "interrupted"
    assert facts(campaign, RunEnded)[-1].exit_code == 130
    assert np.abs(robot.qd).max() == 0.0


def killed_after_a_motion(campaign: Campaign) -> None:
    """A run that ends when its first whole motion is recorded, and before the log is ingested."""

    class Killed(Exception):
        pass

    def kill(event: str, fields: Any) -> None:
        if event == "motion_ended" and fields["part"] == "motion" and not fields["first"]:
            raise Killed

    with pytest.raises(Killed):
        moved(campaign, Robot(), told=kill)


def test_no_motion_is_run_twice_for_one_log(tmp_path: Path) -> None:
    campaign = lab(tmp_path)
    killed_after_a_motion(campaign)
    assert facts(campaign, Ingested) == []
    moved(campaign, Robot())
    whole = [e for e in events(campaign) if isinstance(e.fact, MotionSent) and e.fact.part == "motion"]
    assert [e.number for e in whole if not e.fact.first] == [1, 2]  # type: ignore[union-attr]
    assert [fact.foreign for fact in facts(campaign, Ingested)] == [False, False]
    untell(campaign, 2)
    assert pending_recordings(campaign) == [], "what was taken back stays so"


def test_a_recording_whose_cycles_came_late_is_no_evidence(tmp_path: Path) -> None:
    """Its commands are not those of its motion: nothing is said of signs, and the motion is run again."""
    campaign = lab(tmp_path)
    killed_after_a_motion(campaign)
    [(_, path)] = pending_recordings(campaign)
    recording = read_recording(path)
    write_recording(path, replace(recording, late=len(recording.t) // 3))
    assert pending_recordings(campaign) == []
    with pytest.raises(DataError, match="cycles were late") as refused:
        tell(campaign, path)
    assert "sign" not in f"{refused.value} {refused.value.next_step}"


def test_a_refused_log_is_refused_again_before_anything_moves(tmp_path: Path) -> None:
    class Silent(Robot):
        def state(self) -> Sample:
            return replace(super().state(), command=np.zeros(2))

    campaign, again = lab(tmp_path), Robot()
    with pytest.raises(DataError):
        moved(campaign, Silent())
    with pytest.raises(DataError) as refused:
        moved(campaign, again)
    assert again.sent == []
    words = shlex.split(refused.value.next_step.partition("Answer with: ")[2].partition(". Without")[0])
    assert words[:3] == ["etude", "tell", str(campaign.path)]
    assert cli.main(words[1:]) == DataError.exit_code
    Path(words[3]).unlink()
    moved(campaign, again)
    assert [fact.foreign for fact in facts(campaign, Ingested)] == [False]


def test_cycles_that_come_late_are_told(tmp_path: Path) -> None:
    said: list[str] = []
    robot = Robot()

    def slow(event: str, fields: Any) -> None:
        if event == "motion_sent" and fields["part"] == "motion" and not fields["first"]:
            robot.at = {len(robot.sent) + n: lambda: robot.stall(0.04) for n in range(20, 100, 20)}

    moved(lab(tmp_path), robot, told=slow, say=said.append)
    late = [own for own in said if "cycles were late" in own]
    assert len(late) == 1
    assert re.match(r"4 of ", late[0])


def test_a_robot_that_stands_outside_its_limits_is_not_moved(tmp_path: Path) -> None:
    robot = Robot(start=np.array([0.0, 1.3]))
    with pytest.raises(UsageError, match=r"hip is at 1\.3, outside its limits -1\.\.1") as refused:
        moved(lab(tmp_path), robot)
    assert robot.sent == []
    assert "--from" not in str(refused.value), "etude run has no such option"


def test_after_a_crash_it_asks_and_plans_anew_from_where_it_stands(tmp_path: Path) -> None:
    campaign = lab(tmp_path)

    class Power(Exception):
        pass

    class Cut(Streamed):
        def play(self, *_: Any) -> Any:
            raise Power

    with pytest.raises(Power):
        moved(campaign, Cut(Robot()))
    assert facts(campaign, MotionEnded) == []
    elsewhere = Robot(start=np.array([0.2, -0.3]))
    with pytest.raises(UsageError, match="the robot may have moved"):
        moved(campaign, elsewhere)
    assert elsewhere.sent == []
    alert = etude.status(campaign)["alerts"][0]
    assert (alert["code"], alert["light"]) == ("motion_open", "red")
    assert "the robot may have moved" in alert["sentence"]
    assert f"etude run {campaign.path} --on small --resume" in alert["step"]
    moved(campaign, elsewhere, resume=True)
    assert all(one["code"] != "motion_open" for one in etude.status(campaign)["alerts"])
    approach = facts(campaign, MotionSent)[1]
    assert approach.part == "approach"
    assert approach.start == pytest.approx((-0.3, 0.2))
    assert facts(campaign, Ingested)[0].foreign is False


def test_another_identity_is_asked_about(tmp_path: Path) -> None:
    campaign = lab(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        moved(campaign, Robot(), Somebody(lets_go_after=20))
    with pytest.raises(UsageError, match="Earlier recordings are of fake-1, but this robot is fake-2"):
        moved(campaign, Robot(identity="fake-2"))
    moved(campaign, Robot(identity="fake-2"), identity="fake-2", dry=True)


@pytest.mark.slow
def test_a_payload_that_the_robot_states_is_asked_about_when_it_changes(tmp_path: Path) -> None:
    campaign = lab(tmp_path)
    moved(campaign, Robot(payload=0.5))
    moved(campaign, Robot(payload=0.5), dry=True)
    loaded = Robot(payload=1.2)
    with pytest.raises(UsageError, match=r"set to carry 0\.5 kg, .* fake-1, set to carry 1\.2 kg") as refused:
        moved(campaign, loaded)
    assert loaded.sent == []
    _, named, *_ = shlex.split(
        refused.value.next_step.partition("the campaign with this robot: ")[2].partition(". Else")[0]
    )
    moved(campaign, loaded, identity=named)
    moved(campaign, Robot(payload=1.2), dry=True)


class Reticent(Robot):
    """It tells what it is set to carry once it is connected."""

    def __enter__(self) -> Reticent:
        self.says["payload"] = self.load
        return self

    def __exit__(self, *_: object) -> None:
        del self.says["payload"]

    def __init__(self, load: float, **says: Any) -> None:
        super().__init__(**says)
        self.load = load


def test_a_payload_that_is_told_with_the_connection_is_asked_about_before_anything_moves(
    tmp_path: Path,
) -> None:
    campaign = lab(tmp_path)
    moved(campaign, Reticent(0.5))
    moved(campaign, Reticent(0.5), dry=True)
    for loaded, named in ((Reticent(1.2), "fake-1"), (Reticent(0.5, identity="fake-2"), "fake-2")):
        with pytest.raises(UsageError, match=f"set to carry 0.5 kg, but this robot is {named}"):
            moved(campaign, loaded)
        assert loaded.sent == []
    moved(campaign, Reticent(1.2), identity="fake-1, set to carry 1.2 kg", dry=True)
    moved(campaign, Reticent(1.2, identity="fake-2"), identity="fake-2, set to carry 1.2 kg", dry=True)


@pytest.mark.slow
def test_a_load_that_nobody_states_is_noticed_and_asked_about(tmp_path: Path) -> None:
    """In MuJoCo, whose masses the campaign does not know."""
    pytest.importorskip("mujoco", reason="the driver mujoco needs MuJoCo")
    campaign, on = weighing(tmp_path, 20.0), f"mujoco:{tmp_path / 'two.urdf'},virtual"

    def run(payload: float, **options: Any) -> Any:
        return moved(campaign, find_driver(on, campaign.axes, {"payload": payload}), **options)

    run(0.0, rounds=2)
    with pytest.raises(EtudeError, match="the robot has changed: log 3") as found:
        run(1.0)
    print(found.value.fact)
    assert found.value.exit_code == 6
    with pytest.raises(UsageError, match="Log 3 waits for an answer about a change of the robot"):
        run(1.0)
    answer(campaign, campaign.state(), "new", [3])
    assert run(1.0).why == "1 rounds are done"


def test_a_payload_that_changes_in_a_run_is_sent_nothing_more(tmp_path: Path) -> None:
    robot = Robot(payload=0.5)
    robot.at[20] = lambda: robot.says.update(payload=1.2)
    with pytest.raises(UsageError, match=r"'fake-1, set to carry 1\.2 kg', not"):
        moved(lab(tmp_path), robot)


def test_one_campaign_and_one_robot_have_one_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    campaign, other = lab(tmp_path / "a"), lab(tmp_path / "b")
    refused: list[str] = []

    def second(of: Campaign) -> None:
        with pytest.raises(UsageError) as error:
            moved(of, Robot(real=True), dry=True)
        refused.append(error.value.fact)

    robot = Robot(real=True)
    robot.at = {5: lambda: second(campaign), 6: lambda: second(other)}
    with pytest.raises(KeyboardInterrupt):
        moved(campaign, robot, Somebody(lets_go_after=20))
    assert refused == [
        "another etude run is active in this campaign",
        "another etude run moves this robot, fake-1",
    ]


def test_a_full_disk_is_seen_before_anything_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign, robot = lab(tmp_path), Robot()
    moved(campaign, robot, dry=True)
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**9, 10**9, 10**6))
    with pytest.raises(UsageError, match="the disk has 1 MB left"):
        moved(campaign, robot)
    assert robot.sent == []
    assert facts(campaign, MotionSent) == []


def test_a_disk_that_fills_up_meanwhile_loses_a_recording_and_no_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign, robot = lab(tmp_path), Robot()

    def full(path: Path, _: Any) -> None:
        raise EtudeError("could not write: No space left on device", where=str(path))

    monkeypatch.setattr("etude.campaign.run.robot_session.write_recording", full)
    with pytest.raises(EtudeError, match="No space left"):
        moved(campaign, robot)
    ended = facts(campaign, MotionEnded)
    assert [(one.part, one.ended, one.recording) for one in ended] == [("approach", "done", "")]
    assert np.abs(robot.qd).max() == 0.0


def test_a_fault_of_the_robot_is_its_own_word(tmp_path: Path) -> None:
    campaign, robot = lab(tmp_path), Robot()
    robot.at = {40: lambda: setattr(robot, "fault", "protective stop")}
    with pytest.raises(RobotStopped, match="protective stop"):
        moved(campaign, robot)
    with pytest.raises(RobotStopped, match="reports a fault: protective stop"):
        moved(campaign, robot)


@pytest.mark.parametrize("method", ["__enter__", "__exit__"])
def test_a_driver_that_fails_to_connect_or_to_let_go_is_blamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    def fails(*_: object) -> None:
        raise RuntimeError("no answer")

    monkeypatch.setattr(Robot, method, fails)
    with pytest.raises(EtudeError, match=r"the driver .* RuntimeError: no answer") as found:
        moved(lab(tmp_path / "lab"), Robot(), dry=True)
    assert found.value.exit_code == {"__enter__": 8, "__exit__": 7}[method]


def test_joints_are_matched_by_name(tmp_path: Path) -> None:
    campaign, robot = lab(tmp_path), Robot(start=np.array([0.1, 0.4]))
    moved(campaign, robot, dry=True)
    person = Somebody()
    with pytest.raises(KeyboardInterrupt):
        moved(campaign, robot, Somebody(lets_go_after=5))
    assert facts(campaign, MotionSent)[0].start == pytest.approx((0.4, 0.1))
    assert robot.sent[0] == pytest.approx(np.array([0.1, 0.4]), abs=1e-3)
    assert campaign.axes != JOINTS
    assert person.read == []


def test_about_is_read(tmp_path: Path) -> None:
    campaign, person = lab(tmp_path), Somebody(word="no")
    with pytest.raises(UsageError, match="the motion was not confirmed"):
        moved(campaign, Robot(real=True, on_loss="goes on"), person)
    text = " ".join(person.read)
    assert "keep a hand on its emergency stop" in text
    assert "GOES ON" in text
    assert About.__name__ == "About"


BOT = """\
from etude.testing import FakeRobot
def bot(joints, address, settings):
    return FakeRobot(joints, **settings)
"""


def weighing(folder: Path, duration: float = 4.0, effort: float = 60.0) -> Campaign:
    """A campaign of two joints in a row that carry weight, by a model file."""
    links = "".join(
        f'<link name="{n}"><inertial><origin xyz="0.2 0 0"/><mass value="2"/><inertia ixx="0.01" iyy="0.02"'
        f' izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for n in ("base", "upper", "fore")
    )
    joints = "".join(
        f'<joint name="{n}" type="revolute"><parent link="{a}"/><child link="{b}"/><origin xyz="0.4 0 0"/>'
        f'<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="1" effort="{effort}"/></joint>'
        for n, a, b in (("hip", "base", "upper"), ("knee", "upper", "fore"))
    )
    (folder / "two.urdf").write_text(f'<robot name="two">{links}{joints}</robot>')
    path = etude.create_campaign(folder / "lab", str(folder / "two.urdf"), seed=3)[0].path
    text = QUICK.replace("duration = 4.0", f"duration = {duration}") + "[stop]\nconsecutive = 9\n"
    (path / "campaign.toml").write_text(f'kind = "arm"\nseed = 3\n{text}')
    return open_campaign(path)


@pytest.fixture
def driven(tmp_path: Path) -> Campaign:
    """A campaign whose run.toml names a driver in a file."""
    campaign = lab(tmp_path)
    (tmp_path / "bot.py").write_text(BOT)
    text = f'[driver]\non = "{tmp_path}/bot.py:bot"\nrate = 50.0\n[run]\nrounds = 3\nconfirm = false\n'
    (campaign.path / "run.toml").write_text(text)
    return campaign


def test_a_notebook_has_the_same_robot(driven: Campaign) -> None:
    with etude.connect(driven, yes=True) as robot:
        assert robot.pose() == {"hip": 0.0, "knee": 0.0}
        assert any("3 motions" in own or "stop rule" in own for own in robot.plan())
        assert facts(driven, MotionSent) == []
        with pytest.raises(UsageError, match="another etude run is active in this campaign"):
            moved(driven, Robot(), dry=True)


def test_a_simulation_is_told_where_home_is(driven: Campaign, tmp_path: Path) -> None:
    placed = (
        "class Placed(FakeRobot):\n"
        "    def place(self, pose):\n"
        "        self.__init__(self.joints, start=[pose[joint] for joint in self.joints])\n"
    )
    (tmp_path / "bot.py").write_text(
        BOT.replace("def bot", f"{placed}def bot").replace("return FakeRobot", "return Placed")
    )
    with etude.connect(driven, yes=True) as robot:
        assert robot.pose() == {"hip": 0.0, "knee": -0.5}, "the middle of its ranges"


def test_a_dry_run_at_the_terminal(driven: Campaign, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["run", str(driven.path), "--dry-run", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["why"] == "nothing was moved: --dry-run"
    assert any("3 motions" in own for own in found["notes"])
    assert (found["planned"], found["view"]) == (1, ""), "a robot without a model file has no drawing"
    assert cli.main(["run", str(driven.path), "--dry-run", "--rounds", "0"]) == 2
    assert cli.main(["run", str(driven.path), "--on", "nobody"]) == 2
    assert "there is no driver 'nobody'" in capsys.readouterr().err.lower()


def test_each_line_for_machines_is_of_the_schema(
    driven: Campaign, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    schema = json.loads(files("etude.cli").joinpath("run.schema.json").read_bytes())
    known = Draft202012Validator(schema)
    monkeypatch.setattr("etude.campaign.run.robot_session.STATUS_S", 0.01)
    seen = set()
    for words, code in ((["--dry-run"], 0), (["--rounds", "1", "--yes", "--view"], 0), ([], 2)):
        assert cli.main(["run", str(driven.path), "--json", *words]) == code
        for line in map(json.loads, capsys.readouterr().out.splitlines()):
            known.validate(line)
            seen.add(line.get("event") or next(iter(line)))
    assert seen == {"view", "motion_sent", "status", "motion_ended", "taken_in", "rounds", "error"}


def test_nobody_is_asked_in_a_script(driven: Campaign, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["run", str(driven.path), "--json"]) == 2
    assert (
        json.loads(capsys.readouterr().out)["error"]["fact"] == "the motion was not confirmed; nothing moved"
    )
    assert cli.main(["run", str(driven.path), "--yes", "--heartbeat", str(driven.path / "none")]) == 2


def test_a_wrong_run_toml_is_named(driven: Campaign) -> None:
    (driven.path / "run.toml").write_text("[run]\nround = 3\n")
    with pytest.raises(UsageError, match="unknown key 'round'"):
        read_settings(driven, "bot")
    (driven.path / "run.toml").write_text("")
    with pytest.raises(UsageError, match="the driver of the robot is not named"):
        read_settings(driven)


def test_gravity_that_the_robot_adds_is_learned_and_left_out(tmp_path: Path) -> None:
    """The log has it beside what the robot shows; what is sent and what is expected of it do not."""
    campaign, robot = weighing(tmp_path), Robot(("hip", "knee"), gravity_in_command=False)
    moved(campaign, robot)
    ended = [fact for fact in facts(campaign, MotionEnded) if not fact.first and fact.part == "motion"]
    shown = read_recording(campaign.path / ended[0].recording)
    log = read_log_file(campaign.run_file(1))
    weight = file_gravity(campaign, log["q"])
    assert weight is not None
    assert np.abs(weight).max() > 5.0
    rows = np.searchsorted(shown.t - shown.began, log.t).clip(0, len(shown.t) - 1)
    assert log["command"] - weight == pytest.approx(shown.command[rows], abs=0.5)
    motion = proposal_motion(campaign, 1, "learned")
    model = newest_model(campaign, campaign.state())
    learned = Learned.along(campaign, model, motion, robot.about())
    q = motion.trajectory.motion(learned.t, 1).orders[0]
    total = model.commanded(model.planned(motion.trajectory, COMMAND_HZ))["command"]
    assert total - learned.sent == pytest.approx(file_gravity(campaign, q))
    assert learned.logged == pytest.approx(learned.sent)


def test_old_recordings_are_removed_and_stopped_ones_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("etude.campaign.run.robot_session.KEPT_RECORDINGS", 2)
    campaign, robot = lab(tmp_path), Robot()
    with pytest.raises(KeyboardInterrupt):
        moved(campaign, robot, Somebody(lets_go_after=60))
    moved(campaign, robot)
    ended = facts(campaign, MotionEnded)
    there = {path.name for path in (campaign.path / "recordings").iterdir()}
    wanted = [one for one in ended if one.ended != "done"] + [one for one in ended if one.ended == "done"][
        -2:
    ]
    assert there == {Path(one.recording).name for one in wanted}


def test_the_next_motion_is_computed_beside_the_robot(tmp_path: Path) -> None:
    """By a process of its own, whose errors are this one's."""
    campaign = lab(tmp_path)
    following = NextProposal(campaign, "feedback", beside=True, say=lambda _: None)
    following.begin()
    assert following.number() == 1
    following.end()
    assert [r.number for r in campaign.state().proposals] == [1]
    (campaign.path / "campaign.toml").write_text("seed = 1")
    broken = NextProposal(campaign, "feedback", beside=True, say=lambda _: None)
    broken.begin()
    with pytest.raises(UsageError, match="kind"):
        broken.number()
    broken.end()


LIES: dict[str, Callable[[Array], Array]] = {
    "sign": lambda q: q * np.array([-1.0, 1.0]),
    "degrees": np.degrees,
    "exchanged": lambda q: q[::-1],
}


@pytest.mark.parametrize("lie", LIES)
def test_a_robot_that_lies_is_stopped_before_it_has_gone_far(tmp_path: Path, lie: str) -> None:
    class Liar(Robot):
        def state(self) -> Sample:
            own = super().state()
            return replace(own, q=LIES[lie](own.q))

    campaign, robot = lab(tmp_path), Liar()
    with pytest.raises((RobotStopped, UsageError, UnsafeTrajectoryError)):
        moved(campaign, robot)
    assert facts(campaign, Ingested) == []
    assert all(one.part == "approach" or one.first for one in facts(campaign, MotionSent))
    assert np.abs(robot.q).max() < 0.6, "it was at home, and its way was slow"


def test_the_bounds_shrink_with_what_whole_motions_have_shown(done: tuple[Campaign, Robot, Any]) -> None:
    campaign, robot, _ = done
    motion = proposal_motion(campaign, 1, "feedback")
    own = [f for f in facts(campaign, MotionEnded) if f.control == "feedback"]
    seen = [np.array(f.worst_error) for f in own]
    whole = [f.part == "motion" and not f.first for f in own]
    bounds = motion.bounds(campaign, robot.about())
    assert np.all(bounds.error > 2.0 * np.max(seen, axis=0))
    assert np.all(bounds.error < 0.08), "assumed it was 4 times 2 % of the range, 0.16"
    coarse = replace(robot.about(), encoder_step=np.array([0.02, 0.0]))
    assert motion.bounds(campaign, coarse).error[1] == pytest.approx(0.1), "the knee's, by name"
    assert bounds.residual is None
    model = newest_model(campaign, campaign.state())
    learned = Learned.along(campaign, model, motion, robot.about())
    pushed = replace(motion, control="learned", learned=learned).bounds(campaign, robot.about()).residual
    assert pushed is not None
    assert np.all(pushed >= (0.05 * 20.0, 0.05 * 10.0))
    assert np.all(pushed < 5.0)
    ways = [
        np.array(f.residual) for f in facts(campaign, MotionEnded) if f.control == "learned" and f.residual
    ]
    assert np.all(pushed > 2.0 * np.max(ways, axis=0)), "a way begins anywhere in the band of friction"
    ran = replace(proposal_motion(campaign, 2, "learned"), learned=learned)
    slow, own_speed, fast = (
        replace(ran, trajectory=ran.trajectory.slowed(factor)).bounds(campaign, robot.about()).residual
        for factor in (2.0, 1.0, 0.2)
    )
    np.testing.assert_array_equal(slow, own_speed)
    assert fast is not None
    assert np.all(fast > 4.0 * 2.0 * np.max(ways, axis=0)), "what a model misses grows with the speed"
    alone = 2.0 * np.max([f for f, own in zip(seen, whole, strict=True) if own], axis=0)
    faded = replace(motion, control="learned").bounds(campaign, robot.about()).error
    assert np.all(faded >= alone), "where a model knows nothing the feedback is left"
