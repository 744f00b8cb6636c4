"""What the numbers alone tell: faults are named, or mended where nothing is lost; right logs are silent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from made_motion import CHANNELS, COMMAND, NAMES, QD, RATE, Q, moved

from etude.logs import Mendable, clean_log, judge_numbers
from etude.logs.checks.plausibility import repaired
from etude.types import Array, Channel, Finding, Log

Change = Callable[[Log], Log]
ONCE = {"q": (np.full(3, -3.0), np.full(3, 3.0))}
ENDLESS = {"q": (np.full(3, -12.5), np.full(3, 12.5))}


def noisy(seed: int = 0, *, velocities: bool = True, seconds: float = 20.0) -> Log:
    """A right log, with the noise of sensors."""
    log, rng = moved(seconds, velocities=velocities, seed=seed), np.random.default_rng(seed)
    sizes = {"q": 2e-5, "qd": 2e-3, "command": 0.05}
    return changed(log, **{n: v + sizes[n] * rng.normal(size=v.shape) for n, v in log.values.items()})


def changed(log: Log, **values: Array) -> Log:
    return replace(log, values={**log.values, **values})


def told(log: Log, limits: dict[str, tuple[Array, Array]] = ONCE) -> list[Finding]:
    return [f for f in judge_numbers(log, limits) if f.light != "green"]


def one(log: Log, limits: dict[str, tuple[Array, Array]] = ONCE) -> Mendable:
    (found,) = told(log, limits)
    assert isinstance(found, Mendable)
    return found


def held(log: Log, rows: float, *names: str) -> Log:
    """Channels as a slower sensor gives them; each value stands for `rows` rows."""
    index = np.floor(np.floor(np.arange(len(log)) / rows + 1e-9) * rows + 1e-9).astype(int)
    return replace(log, values={n: v[index] if n in names else v for n, v in log.values.items()})


def lost(log: Log, share: float, seed: int = 0) -> tuple[Log, Log]:
    """The log less some rows, with times that count rows, and with true ones."""
    left = log.take(np.random.default_rng(seed).random(len(log)) > share)
    return replace(left, t=log.t[: len(left)]), left


def wrapped(log: Log, turn: float = 2.0 * np.pi, scale: float = 1.0) -> Log:
    q = scale * (log["q"] + [0.0, 0.0, np.pi - log["q"][0, 2] - 0.1])
    return changed(log, q=(q + 0.5 * turn) % turn - 0.5 * turn)


@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_right_logs_are_silent(seed: int, velocities: bool) -> None:
    log = noisy(seed, velocities=velocities, seconds=60.0)
    assert told(log) == []
    for start in range(0, 50, 5):
        assert told(log.take((log.t >= start) & (log.t < start + 6))) == []


def coarse(log: Log) -> Log:
    return changed(log, q=np.round(log["q"], 3), command=np.round(log["command"], 1)).without("qd")


def late_packets(log: Log) -> Log:
    """Some rows repeat the one before, and the next has gone twice as far."""
    late = np.random.default_rng(1).random(len(log)) < 0.05
    index = np.arange(len(log)) - late
    index[0] = 0
    return replace(log, values={n: v[index] for n, v in log.values.items()})


def program_of_steps(log: Log) -> Log:
    index = (np.arange(len(log)) // 100) * 100
    return changed(log, command=log["command"][index])


def relay(log: Log) -> Log:
    """Commands that are switched from one end of their range to the other."""
    jitter = 0.05 * np.random.default_rng(2).normal(size=log["command"].shape)
    return changed(log, command=20.0 * np.sign(np.sin(log.t))[:, None] + jitter)


def dry_friction(log: Log) -> Log:
    """Commands that are all Coulomb friction: a jump at each reversal, along the slope on either side."""
    return changed(log, command=20.0 * np.sign(log["qd"]) + 0.5 * log["qd"])


def resting_at_zero(log: Log) -> Log:
    """A lift that only ever pushes, and rests with drives off."""
    lift = np.clip(np.sin(0.2 * np.pi * log.t[:, None] + [0.0, 0.2, 0.4]), 0.0, None)
    return changed(log, command=30.0 * lift + 0.0 * log["command"], q=lift + 1e-4 * log["q"]).without("qd")


def holding_weight(log: Log) -> Log:
    return changed(log, command=100.0 + log["command"])


def counting(log: Log, each: int) -> Array:
    """(T, 3) an encoder at constant speed, there and back, whose count changes every `each` rows by one."""
    counts = (np.arange(len(log))[:, None] + np.array([0, 150, 300])) // each
    return np.asarray(1e-3 * np.abs((counts + 200) % 400 - 200))


def slow_and_coarse(log: Log) -> Log:
    return changed(log, q=counting(log, 3)).without("qd")


def slow_and_coarse_throughout(log: Log) -> Log:
    return changed(log, q=counting(log, 3), command=100.0 - 1e3 * counting(log, 3)).without("qd")


def point_to_point(log: Log) -> Log:
    """Short moves between rests, velocities with much noise."""
    way = np.clip((log.t % 2.0) / 0.4, 0.0, 1.0)
    q = 0.4 * (log.t // 2.0 + way**2 * (3.0 - 2.0 * way))[:, None] * [1.0, -1.0, 0.5]
    rng = np.random.default_rng(5)
    qd = np.gradient(q, log.t, axis=0) + 0.1 * rng.normal(size=q.shape)
    return changed(log, q=q + 2e-4 * rng.normal(size=q.shape), qd=qd)


def coasting(log: Log) -> Log:
    """Commands that fade to zero, and come back, while the joints go on."""
    return changed(log, command=log["command"] * np.clip(np.abs(log.t - 10.0) - 1.0, 0.0, 1.0)[:, None])


def drives_off_at_rest(log: Log) -> Log:
    rest = (log.t > 5.0) & (log.t < 7.0)
    q, command = log["q"].copy(), log["command"].copy()
    q[rest], command[rest] = q[rest][0], 0.0
    q[log.t >= 7.0] += q[rest][0] - log["q"][log.t >= 7.0][0]
    return changed(log, q=q, command=command).without("qd")


def controlled_at_100_hz(log: Log) -> Log:
    """In a log of 1 kHz: drives have no faster set-points."""
    return replace(held(log, 10.0, "command"), t=0.1 * log.t).without("qd")


def rounded_to_nothing(log: Log) -> Log:
    command = log["command"].copy()
    command[:, 2] = 1e-13 * log["q"][:, 0]
    return changed(log, command=command)


def switched_at_rest(log: Log) -> Log:
    """A friction compensation whose sign follows the noise of a standing joint."""
    rng = np.random.default_rng(3)
    rest = (log.t > 5) & (log.t < 6)
    command = log["command"].copy()
    command[rest] = rng.choice([-60.0, 0.0, 60.0], size=(int(rest.sum()), 3))
    return changed(log, command=command)


def noisy_above_zero(log: Log) -> Log:
    """A weight that is nearly balanced at the end of each swing, with noise."""
    rng = np.random.default_rng(4)
    return changed(log, command=1.0 + np.cos(log.t)[:, None] + 0.01 * np.abs(rng.normal(size=(len(log), 3))))


@pytest.mark.parametrize(
    "change",
    [
        slow_and_coarse,
        slow_and_coarse_throughout,
        point_to_point,
        coasting,
        drives_off_at_rest,
        controlled_at_100_hz,
        rounded_to_nothing,
        switched_at_rest,
        noisy_above_zero,
        coarse,
        late_packets,
        program_of_steps,
        relay,
        dry_friction,
        resting_at_zero,
        holding_weight,
    ],
)
def test_logs_that_look_odd_and_are_right_are_silent(change: Change) -> None:
    assert [f.sentence for f in told(change(noisy(seconds=60.0)))] == []


@pytest.mark.parametrize("rows", [1.6, 2.0, 3.0, 8.0])
@pytest.mark.parametrize("velocities", [True, False])
def test_rows_that_are_held_are_dropped(rows: float, velocities: bool) -> None:
    log = noisy(velocities=velocities)
    wrong = held(log, rows, *log.values)
    found = one(wrong)
    assert (found.check, found.free, found.flag) == ("held", True, "")
    assert f"Every row is repeated {rows:.2g} times: the sensors give " in found.sentence
    mended = repaired(wrong, found)
    assert len(mended) == pytest.approx(len(log) / rows, abs=1)
    assert np.isin(mended["q"], log["q"]).all()
    assert told(mended) == []


def test_rest_among_held_rows_changes_nothing() -> None:
    wrong = held(noisy(), 4.0, "q", "qd", "command")
    stand = np.concatenate([np.arange(800), np.full(300, 800), np.arange(800, len(wrong))])
    found = one(replace(wrong.take(stand), t=np.arange(len(stand)) / RATE))
    assert "is repeated 4 times" in found.sentence


def test_held_rows_are_told_by_the_fast_motion_of_a_coarse_sensor() -> None:
    log = coarse(noisy(seconds=60.0))
    slow = np.where(log.t % 10.0 < 8.0, 0.02, 1.0)[:, None]
    q = np.cumsum(np.diff(log["q"], axis=0, prepend=log["q"][:1]) * slow, axis=0)
    crawling = changed(log, q=2e-3 * np.round(500.0 * q), command=np.round(log["command"] * slow, 0))
    assert one(held(crawling, 4.0, "q", "command")).check == "held"


def test_positions_that_are_held_beside_fresh_commands_leave_the_new_rows() -> None:
    wrong = held(noisy(), 4.0, "q", "qd")
    found = one(wrong)
    assert (found.check, found.free) == ("held", True)
    mended = repaired(wrong, found)
    assert len(mended) == 500
    assert told(mended) == []


def test_commands_that_are_held_are_refused_by_name() -> None:
    found = one(held(noisy(), 10.0, "command"))
    assert (found.check, found.light, found.flag) == ("held_commands", "red", "held_commands")
    assert "10 times a second in a log of 100" in found.sentence


@pytest.mark.parametrize(("velocities", "limits"), [(True, ONCE), (False, ENDLESS)])
def test_angles_are_unwrapped_where_joints_turn_on_or_velocities_show_it(
    velocities: bool, limits: dict[str, tuple[Array, Array]]
) -> None:
    log = noisy(velocities=velocities)
    wrong = wrapped(log)
    found = one(wrong, limits)
    assert (found.check, found.free) == ("turns", True)
    assert found.sentence.startswith("toe: ")
    mended = repaired(wrong, found)
    np.testing.assert_allclose(np.diff(mended["q"], axis=0), np.diff(log["q"], axis=0), atol=1e-9)
    assert told(mended, limits) == []


def test_velocities_that_deny_a_wrap_leave_it_a_refusal() -> None:
    log = noisy()
    found = one(changed(wrapped(log), qd=-log["qd"]))
    assert (found.check, found.light, found.free) == ("turns", "red", False)


@pytest.mark.parametrize(("turn", "scale"), [(2.0 * np.pi, 1.0), (360.0, 180.0 / np.pi)])
def test_other_angles_that_wrap_are_refused_with_their_repair(turn: float, scale: float) -> None:
    log = noisy(velocities=False)
    wrong = wrapped(log, turn, scale)
    found = one(wrong)
    assert (found.check, found.light, found.flag, found.free) == ("turns", "red", "turns", False)
    assert "--repair turns" in found.step
    steps = np.diff(repaired(wrong, found)["q"], axis=0)
    np.testing.assert_allclose(steps, scale * np.diff(log["q"], axis=0), atol=1e-9)


def test_angles_from_0_to_a_turn_are_put_within_the_limits() -> None:
    """One joint crosses 0, one lies below it throughout, one above."""
    log = noisy()
    right = log["q"] - log["q"].mean(axis=0) + [0.0, -1.6, 1.6]
    wrong = changed(log, q=right % (2.0 * np.pi))
    found = one(wrong)
    assert found.free
    assert not one(wrong.without("qd")).free
    assert found.sentence.startswith("hip: ")
    assert "; knee: whole turns outside the limits" in found.sentence
    np.testing.assert_allclose(repaired(wrong, found)["q"], right, atol=1e-9)
    assert told(repaired(wrong, found)) == []


def test_a_leap_that_is_no_turn_is_no_wrap() -> None:
    log = wrapped(noisy())
    q = log["q"].copy()
    q[900:, 2] += 4.0
    assert "turns" not in {f.check for f in told(changed(log, q=q), ENDLESS)}


def test_sliding_joints_have_no_turns() -> None:
    log = wrapped(noisy())
    sliding = Channel("q", NAMES, ("m",) * 3, required=True)
    assert "turns" not in {f.check for f in told(log.put(sliding, log["q"]), ENDLESS)}


@pytest.mark.parametrize("source", ["command", "q", "qd"])
def test_a_copied_column_is_named_with_its_twin(source: str) -> None:
    log = noisy()
    command = log["command"].copy()
    command[:, 2] = 1.5 * log[source][:, 0]
    found = one(changed(log, command=command))
    names = {"command": "command", "q": "position", "qd": "velocity"}
    assert (found.check, found.light, found.flag) == ("copied", "red", "copied")
    assert "the command of toe" in found.sentence
    assert f"the {names[source]} of hip" in found.sentence


def test_a_joint_that_feedback_holds_is_no_copy() -> None:
    log = noisy()
    command = log["command"].copy()
    command[:, 2] = 3.0 - 800.0 * log["q"][:, 2]
    assert told(changed(log, command=command)) == []


def test_two_joints_that_stand_are_no_copies() -> None:
    log = noisy()
    command = log["command"].copy()
    command[:, 1:] = [3.0, -2.0]
    assert told(changed(log, command=command)) == []


def test_unsigned_commands_are_refused_in_a_long_log_and_asked_of_a_short_one() -> None:
    log = noisy(seconds=60.0)
    wrong = changed(log, command=np.abs(log["command"]))
    assert (one(wrong).check, one(wrong).light) == ("unsigned", "red")
    brief = next(f for n in range(200, 4000, 20) for f in told(wrong.take(slice(0, n))))
    assert (brief.check, brief.light, brief.flag) == ("unsigned", "yellow", "unsigned")
    assert " times (odds " in brief.sentence
    assert "--accept unsigned" in brief.step
    counts = np.round(20.0 * log["command"])
    in_a_bit = changed(log, command=np.where(counts < 0.0, 1024.0 - counts, counts))
    assert any("bit 10: write 1024 - value" in found.step for found in told(in_a_bit))
    assert "bit" not in one(changed(log, command=np.abs(counts))).step
    signed = wrong["command"].copy()
    signed[:, 1] = log["command"][:, 1]
    assert told(changed(log, command=signed)) == []


def test_a_stretch_without_commands_is_cut() -> None:
    log = noisy()
    command = log["command"].copy()
    command[500:700] = 0.0
    wrong = changed(log, command=command)
    found = one(wrong)
    assert (found.check, found.free) == ("off", True)
    assert "For 2 s all commands are zero" in found.sentence
    mended = repaired(wrong, found)
    assert len(mended) == len(log) - 200
    assert mended["command"].any(axis=1).all()
    command[300:1500] = 0.0
    assert (one(changed(log, command=command)).light, told(changed(log, command=command))[0].flag) == (
        "red",
        "off",
    )


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_command_that_overflows_is_named(noise: float) -> None:
    """Also one whose noise, in parts of its range, is not small beside a wrap."""
    log = noisy()
    command = log["command"].copy()
    command[:, 0] += noise * np.ptp(command[:, 0]) * np.random.default_rng(6).normal(size=len(log))
    top = 0.7 * np.abs(command[:, 0]).max()
    command[:, 0] = (command[:, 0] + top) % (2.0 * top) - top
    found = one(changed(log, command=command))
    assert (found.check, found.light) == ("overflow", "red")
    assert "command of hip jumps" in found.sentence
    assert f"{top:.1f}"[:3] in found.sentence


@pytest.mark.parametrize("share", [0.01, 0.03, 0.1])
def test_lost_rows_are_put_in_their_time_by_velocities(share: float) -> None:
    wrong, right = lost(noisy(seconds=60.0), share)
    found = one(wrong)
    assert (found.check, found.free, found.flag) == ("lost", True, "")
    mended = repaired(wrong, found)
    off = np.abs(np.diff(mended.t) - np.diff(right.t)) > 1e-6
    assert off.mean() < 0.15 * share
    assert told(mended) == []


def test_lost_rows_without_velocities_are_a_question_with_a_repair() -> None:
    wrong, right = lost(noisy(seconds=60.0, velocities=False), 0.03)
    found = one(wrong)
    assert (found.check, found.light, found.flag, found.free) == ("lost", "red", "lost", False)
    assert "--repair lost" in found.step
    mended = repaired(wrong, found)
    before, after = (np.abs(np.diff(log.t) - np.diff(right.t)).sum() for log in (wrong, mended))
    assert after < 0.3 * before


def test_velocities_that_go_on_when_joints_stop_hide_no_lost_rows() -> None:
    """The steps around tell more than they do, though not where a row was lost."""
    log, rng = moved(60.0), np.random.default_rng(7)
    q, qd = log["q"].copy(), log["qd"] + 2e-3 * rng.normal(size=log["qd"].shape)
    q[-20:] = q[-20] + 1e-6 * rng.normal(size=(20, 3))
    assert one(lost(changed(log, q=q, qd=qd), 0.01)[0]).check == "lost"


def test_lost_rows_are_told_among_late_packets() -> None:
    assert one(lost(late_packets(noisy(seconds=60.0)), 0.03)[0]).check == "lost"


@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize("share", [0.0005, 0.002, 0.03])
def test_true_stamps_lose_nothing(share: float, velocities: bool) -> None:
    """Few gaps leave a clock even; the stamps show each of them."""
    assert told(lost(noisy(seconds=60.0, velocities=velocities), share)[1]) == []


@pytest.mark.parametrize("hole", ["t", "q", "qd", "command"])
def test_rows_with_a_cell_that_is_not_a_number_are_not_called_lost(hole: str) -> None:
    """Their rows are dropped; those left keep their times."""
    log = noisy(seconds=60.0, velocities=hole == "qd")
    rows = np.random.default_rng(1).random(len(log)) < 0.002
    if hole == "t":
        holed = replace(log, t=np.where(rows, np.nan, log.t))
    else:
        holed = changed(log, **{hole: np.where(rows[:, None], np.nan, log[hole])})
    cleaned = clean_log(holed, CHANNELS)
    assert len(cleaned) == len(log) - rows.sum()
    assert told(cleaned) == []


def test_a_vehicle_whose_rows_are_held_is_told_and_its_motors_are_not_unsigned() -> None:
    log = noisy(seconds=60.0).without("q").without("qd")
    motors = Channel("command", NAMES, ("V",) * 3, "command", required=True)
    rates = Channel("rates", ("x", "y", "z"), ("rad/s",) * 3)
    flown = (
        Log(log.t, {}, {}, "made")
        .put(motors, np.abs(log["command"]))
        .put(rates, noisy(1, seconds=60.0)["qd"])
    )
    assert told(flown) == []
    assert one(held(flown, 2.0, "command", "rates")).check == "held"


def test_a_short_log_says_nothing() -> None:
    log = noisy()
    assert told(held(log, 4.0, "q", "qd", "command").take(slice(0, 30))) == []


def test_robots_without_positions_are_not_judged() -> None:
    log = noisy().without("q").without("qd")
    assert told(Log(log.t, {}, {}, "made").put(COMMAND, np.abs(log["command"]))) == []
    assert (Q.name, QD.name) == ("q", "qd")


def clipped(log: Log, part: float, joint: int = 1) -> tuple[Log, float]:
    """The command of a joint cut at a part of its largest, and that level."""
    u = log["command"].copy()
    level = part * float(np.abs(u[:, joint]).max())
    u[:, joint] = np.clip(u[:, joint], -level, level)
    return changed(log, command=u), level


@pytest.mark.parametrize("part", [0.5, 0.7, 0.85])
def test_clipped_commands_are_named_with_their_level_and_cut(part: float) -> None:
    log, level = clipped(noisy(), part)
    finding = one(log)
    assert (finding.check, finding.light, finding.flag) == ("clipped", "red", "clipped")
    assert f"the commands of {NAMES[1]} stay at " in finding.sentence.lower()
    assert f"{level:.4g}" in finding.sentence
    left = repaired(log, finding)
    assert told(left) == []
    assert 0 < len(log) - len(left) < 0.7 * len(log)


def test_at_the_limit_of_the_drive_nothing_is_clipped() -> None:
    log, level = clipped(noisy(), 0.7)
    limits = {**ONCE, "command": (np.full(3, -level), np.full(3, level))}
    assert told(log, limits) == []
    assert (
        one(log, {**ONCE, "command": (np.full(3, -1.5 * level), np.full(3, 1.5 * level))}).check == "clipped"
    )


def test_a_coarse_command_that_stands_everywhere_is_not_clipped() -> None:
    log = noisy()
    u = log["command"]
    steps = np.round(u / (0.05 * np.abs(u).max(axis=0))) * 0.05 * np.abs(u).max(axis=0)
    assert told(changed(log, command=steps)) == []


def test_a_joint_that_stands_may_hold_its_largest_command() -> None:
    log = noisy()
    q, u = log["q"].copy(), log["command"].copy()
    q[1000:1600] = q[1000]
    u[1000:1600] = 1.1 * np.abs(u).max(axis=0)
    assert not any(f.check == "clipped" for f in told(changed(log.without("qd"), q=q, command=u)))


def test_a_drive_that_only_pushes_and_then_does_nothing_is_not_clipped() -> None:
    log = noisy()
    pushes = np.maximum(log["command"], 0.0)
    assert not any(f.check == "clipped" for f in told(changed(log, command=pushes)))


def following(log: Log, scales: Array, order: list[int]) -> Log:
    """The log with desired positions that it follows with some lag; its own are scaled, in another order."""
    plan = Channel("q_des", NAMES, ("rad",) * 3, "plan")
    desired = np.stack([np.interp(log.t + 0.02, log.t, column) for column in log["q"].T], axis=1)
    channels = {**log.channels, "q_des": plan}
    return replace(
        log, channels=channels, values={**log.values, "q": log["q"][:, order] * scales, "q_des": desired}
    )


@pytest.mark.parametrize(
    ("scales", "order", "words"),
    [
        ([1.0, -1.0, 1.0], [0, 1, 2], ["second moves against the desired one"]),
        ([-1.0, 1.0, -1.0], [0, 1, 2], ["first moves against", "third moves against"]),
        ([1.0, 1.0, 57.3], [0, 1, 2], ["third is about 57 times the desired one"]),
        ([1.0, 1.0, 1.0], [0, 2, 1], ["second follows the desired one of third", "third follows"]),
    ],
)
def test_positions_unlike_the_desired_ones(scales: list[float], order: list[int], words: list[str]) -> None:
    found = one(following(noisy().without("qd"), np.array(scales), order))
    assert (found.check, found.light) == ("desired", "red")
    assert found.sentence.count(";") == len(words) - 1
    sentence = found.sentence
    for own, name in zip(("first", "second", "third"), NAMES, strict=True):
        words = [text.replace(own, name) for text in words]
    assert all(text in sentence for text in words), sentence


def test_positions_that_follow_or_stand_are_silent() -> None:
    log = following(noisy().without("qd"), np.ones(3), [0, 1, 2])
    assert told(log) == []
    stuck = log["q"] * [1.0, 1e-5, 1.0]
    assert not any(f.check == "desired" for f in told(changed(log, q=stuck)))
