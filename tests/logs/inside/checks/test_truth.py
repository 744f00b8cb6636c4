"""Wrong logs are told by name and with their sentence; right ones are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from made_motion import CHANNELS, COMMAND, GRAVITY, LIMITS, QD, RATE, Q, command_of, moved

from etude.errors import UsageError
from etude.logs import finding_of, judge_motion, sign_decision
from etude.logs.checks import velocities as rates
from etude.logs.checks.command_units import scale_finding
from etude.logs.checks.command_units import slopes as slopes_of
from etude.logs.checks.plausibility import REPAIRS, commanded, judge_unit, repaired
from etude.types import Array, Finding, Log


def told(log: Log, usual: float | None = RATE) -> dict[str, Finding]:
    """What is flagged, by check; the commands only where the motion is right."""
    motion = judge_motion(log, "q", CHANNELS, LIMITS, usual)
    flagged = [f for f in motion if f.flag] or [f for f in judged(log) if f.flag]
    return {f.check: f for f in flagged}


def judged(log: Log) -> list[Finding]:
    """What is said of the commands that is not silent."""
    found = sign_decision([log], Q) if COMMAND.name in log else None
    return [] if found is None or found.level == "silent" else [finding_of(found, Q.parts, [log.source])]


def with_command(log: Log, columns: Array) -> Log:
    return log.put(COMMAND, np.asarray(columns))


def turned_rows(log: Log) -> Log:
    return replace(log, values={name: part[::-1].copy() for name, part in log.values.items()})


def in_degrees(log: Log, *names: str) -> Log:
    return replace(log, values={n: np.rad2deg(v) if n in names else v for n, v in log.values.items()})


WRONG: dict[str, tuple[Callable[[Log], Log], str, str]] = {
    "sign of one": (
        lambda log: with_command(log, log["command"] * [1, -1, 1]),
        "sign",
        "commands of knee is inverted",
    ),
    "all signs": (lambda log: with_command(log, -log["command"]), "sign", "hip, knee and toe"),
    "half the rate": (lambda log: replace(log, t=2.0 * log.t), "time", "2 times too slow"),
    "twice the rate": (lambda log: replace(log, t=0.5 * log.t), "time", "2 times too fast"),
    "seconds as minutes": (lambda log: replace(log, t=60.0 * log.t), "time", "60 times too slow"),
    "minutes as seconds": (lambda log: replace(log, t=log.t / 60.0), "time", "60 times too fast"),
    "milliseconds": (lambda log: replace(log, t=1e3 * log.t), "time", "1000 times too slow"),
    "reversed": (turned_rows, "direction", "run backwards in time"),
    "positions in degrees": (lambda log: in_degrees(log, "q"), "degrees", "positions are in degrees"),
    "velocities in degrees": (lambda log: in_degrees(log, "qd"), "degrees", "velocities are in degrees"),
    "all in degrees": (lambda log: in_degrees(log, "q", "qd"), "degrees", "look like degrees"),
    "commands swapped": (
        lambda log: with_command(log, log["command"][:, [1, 0, 2]]),
        "swapped",
        "hip fits the",
    ),
    "velocities swapped": (lambda log: log.put(QD, log["qd"][:, [0, 2, 1]]), "velocity", "is toe's"),
    "one velocity's sign": (lambda log: log.put(QD, log["qd"] * [1, 1, -1]), "velocity", "the opposite sign"),
    "one velocity's unit": (lambda log: log.put(QD, log["qd"] * [1, 57.3, 1]), "velocity", "57.3 times the"),
}
WITHOUT = {
    "seconds as minutes": "60 times too slow",
    "minutes as seconds": "60 times too fast",
    "reversed": "Rows that run backwards in time would look the same",
    "positions in degrees": "look like degrees",
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("velocities", [True, False])
def test_a_right_log_raises_no_question(velocities: bool, seed: int) -> None:
    assert told(moved(velocities=velocities, seed=seed)) == {}


@pytest.mark.parametrize("name", WRONG)
def test_every_wrong_log_has_its_sentence(name: str) -> None:
    change, check, sentence = WRONG[name]
    found = told(change(moved()))
    assert list(found) == [check]
    assert sentence in found[check].sentence
    assert f"--accept {check}" in found[check].step


@pytest.mark.parametrize("name", WITHOUT)
def test_without_velocities_limits_and_power_remain(name: str) -> None:
    found = told(WRONG[name][0](moved(velocities=False)))
    assert any(WITHOUT[name] in finding.sentence for finding in found.values())


def test_twice_the_time_is_not_seen_without_velocities_and_not_claimed() -> None:
    assert told(replace(moved(velocities=False), t=2.0 * moved().t)) == {}


def test_57_and_60_are_told_apart_by_the_usual_rate() -> None:
    """A driver's filter takes 4 % off the velocities, so the factor alone does not tell."""
    log = moved()
    slack = log.put(QD, 0.955 * log["qd"])
    assert "time" in told(replace(slack, t=60.0 * slack.t))
    assert "degrees" in told(log.put(QD, np.rad2deg(1.045 * log["qd"])))


@pytest.mark.parametrize("name", [n for n, (_, check, _) in WRONG.items() if check in REPAIRS])
def test_a_repair_gives_the_right_log_back(name: str) -> None:
    change, check, _ = WRONG[name]
    log = moved()
    mended = repaired(change(log), told(change(log))[check])
    np.testing.assert_allclose(mended.t, log.t, rtol=1e-12, atol=1e-12)
    for part in log.values:
        np.testing.assert_array_equal(mended[part], log[part])
    assert mended.repairs[-1].endswith("as asked.")


def test_swapped_and_inverted_at_once_are_repaired_one_after_the_other() -> None:
    log = moved()
    wrong = with_command(log, (log["command"] * [1, -1, 1])[:, [1, 0, 2]])
    once = repaired(wrong, told(wrong)["swapped"])
    assert list(told(once)) == ["sign"]
    np.testing.assert_array_equal(repaired(once, told(once)["sign"])["command"], log["command"])


def test_a_single_wild_position_decides_nothing() -> None:
    log = moved()
    wild = log["q"].copy()
    wild[700, 1] += 40.0
    assert told(log.put(Q, wild)) == {}


def test_what_nothing_repairs_is_said() -> None:
    with pytest.raises(UsageError, match="there is no repair for the check 'degrees'"):
        repaired(moved(), told(in_degrees(moved(), "q"))["degrees"])


def test_slope_and_correlation_are_those_of_least_squares() -> None:
    log = moved()
    noisy = log.put(QD, 1.5 * log["qd"])
    seen = commanded(noisy)
    assert seen is not None
    found = rates.Slopes.of(seen)
    assert found is not None
    np.testing.assert_allclose(found.beta, 1.5, atol=2e-3)
    np.testing.assert_allclose(found.r, 1.0, atol=1e-4)


def test_joints_that_stand_are_left_out() -> None:
    log = moved()
    still = log["q"].copy()
    still[:, 2] = 0.3
    log = log.put(Q, still).put(QD, log["qd"] * [1, 1, 0])
    assert told(log) == {}
    seen = commanded(log)
    assert seen is not None
    assert sign_decision([log], Q).moving.tolist() == [True, True, False]


FAR = np.full(3, np.inf)
"""How far commands reach, of a robot without limits."""


class Body:
    """What a model file would say of the made motion: all but friction."""

    def __init__(self, masses: float = 1.0) -> None:
        self.masses = masses

    def predict(self, log: Log) -> Array:
        q, zero = log["q"], np.zeros_like(log["q"])
        rigid = command_of(q, zero, log["qdd"])
        return np.asarray(self.masses * rigid)

    def static(self, log: Log) -> Array:
        return np.asarray(self.masses * GRAVITY * np.sin(log["q"]))


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1e-3, "kN m"), (1e3, "thousandths of N m"), (1.0 / 120.0, "a gear ratio of about")],
)
def test_another_unit_of_the_commands_is_named(factor: float, words: str) -> None:
    log = with_command(moved(), factor * moved()["command"])
    found = judge_unit(log, Body(), FAR)  # type: ignore[arg-type]
    assert found is not None
    assert found.light == "yellow"
    assert words in found.sentence


def test_percents_of_the_limit_are_named() -> None:
    limit = np.array([20.0, 30.0, 8.0])
    log = with_command(moved(), 100.0 * moved()["command"] / limit)
    found = judge_unit(log, Body(), limit)  # type: ignore[arg-type]
    assert found is not None
    assert "per cent of the limit" in found.sentence


def test_the_right_unit_is_green() -> None:
    found = judge_unit(moved(), Body(), FAR)  # type: ignore[arg-type]
    assert found is not None
    assert found.light == "green"
    slope, like = slopes_of(2.0 * np.eye(3)[:, :1], np.eye(3)[:, :1])
    assert (slope, like) == (pytest.approx([2.0]), pytest.approx([1.0]))


@pytest.mark.parametrize(("way", "moves"), [(0.004, False), (0.02, True)])
def test_a_joint_that_the_others_shake_does_not_move(way: float, moves: bool) -> None:
    """A position in steps of 0.1 mrad, and velocities of a motor behind a spring: not its slopes."""
    log = moved()
    q, qd = log["q"].copy(), log["qd"].copy()
    q[:, 2] = np.round(0.5 * way * np.sin(4.0 * log.t), 4)
    qd[:, 2] = 0.07 * np.sin(23.0 * log.t)
    shaken = log.put(Q, q).put(QD, qd)
    seen = commanded(shaken)
    assert seen is not None
    assert seen.moves.tolist() == [True, True, moves]
    (found, *_) = judge_motion(shaken, "q", CHANNELS, LIMITS, RATE)
    assert (found.light == "red") == moves


def test_a_wheel_that_turns_far_leaves_the_arm_moving() -> None:
    log = moved()
    seen = commanded(log.put(Q, log["q"] * [500.0, 1.0, 1.0]).without("qd"))
    assert seen is not None
    assert seen.moves.all()


def test_noise_is_no_motion() -> None:
    """An arm in its brakes, whose encoders are noisy: refused by name, not for its velocities."""
    log = moved()
    rng = np.random.default_rng(6)
    still = log.put(Q, log["q"][0] + 1e-5 * rng.standard_normal(log["q"].shape)).put(QD, 0.0 * log["qd"])
    (found,) = judge_motion(still, "q", CHANNELS, LIMITS, RATE)
    assert (found.check, found.light) == ("rest", "red")


@pytest.mark.parametrize("joint", range(3))
def test_noise_in_a_position_is_no_wrong_velocity(joint: int) -> None:
    """Velocities regressed on a noisy slope come out too small, as regression on noisy regressors does."""
    log, q = moved(), moved()["q"]
    # a slower topic, joined by time: its noise passes the filter
    q[:, joint] += np.interp(log.t, log.t[::20], 0.03 * np.random.default_rng(1).normal(size=len(log) // 20))
    noisy = commanded(log.put(Q, q))
    assert noisy is not None
    slopes = rates.Slopes.of(noisy)
    assert slopes is not None
    assert 0.5 < slopes.r[joint] < 0.95
    assert slopes.beta[joint] < 0.9, "the noise is large enough to matter"
    assert rates.rate_finding(noisy, RATE).light == "cannot tell"
    velocity = log["qd"].copy()
    velocity[:, joint] *= 0.5  # a factor stays one, noisy position or not
    wrong = commanded(log.put(Q, q).put(QD, velocity))
    assert wrong is not None
    assert rates.rate_finding(wrong, RATE).light == "red"


def test_row_numbers_taken_for_times_are_one_fact_not_one_a_joint() -> None:
    """0.25 in each of three joints: the log has 4 rows a second, says its time column."""
    log = moved()
    found = judge_motion(replace(log, t=4.0 * log.t), "q", CHANNELS, LIMITS, RATE)[0]
    assert found.light == "red"
    assert "4 times the slopes of the positions in every joint" in found.sentence
    assert "a row number" in found.sentence


def pieces(seconds: float) -> list[Log]:
    """Stretches of a right log, which end elsewhere than they began."""
    log = moved(60.0)
    starts = np.arange(0.0, 60.0 - seconds, 2.5)
    return [log.take((log.t >= a) & (log.t < a + seconds)) for a in starts]


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.6, 2.0, 4.0, 6.0, 9.0, 14.0])
def test_a_right_log_that_was_cut_is_not_suspected(seconds: float) -> None:
    for piece in pieces(seconds):
        assert told(piece) == {}
        assert told(piece.without("qd")) == {}


def test_a_weight_that_is_let_down_is_no_inverted_sign() -> None:
    """One way down against friction: gravity drives the motion, and the command takes power out."""
    t = np.arange(1000) / RATE
    q = np.tile(-1.0 + 0.09 * t[:, None], (1, 3))
    qd = np.gradient(q, t, axis=0)
    log = Log(t, {}, {}, "made").put(Q, q).put(COMMAND, command_of(q, qd, 0.0 * q))
    seen = commanded(log)
    assert seen is not None
    assert seen.command is not None
    assert (seen.command * seen.qd).sum(axis=0)[0] < 0.0
    assert told(log) == {}


def test_a_joint_that_moves_for_a_moment_does_not_condemn_its_velocity() -> None:
    """Below its dead band the drive reports none."""
    log = moved(8.0)
    q, qd = log["q"].copy(), log["qd"].copy()
    q[:, 2], qd[:, 2] = 0.002 * np.exp(-(((log.t - 4.0) / 0.1) ** 2)), 0.0
    assert told(log.put(Q, q).put(QD, qd)) == {}


def test_a_torque_that_the_file_hardly_knows_says_nothing_of_a_unit() -> None:
    seen = commanded(moved())
    assert seen is not None
    assert seen.command is not None
    torque = seen.command * [1.0, 1.0, 1e-5]
    found = scale_finding(seen, torque, np.full(3, 100.0))
    assert found is not None
    assert found.light == "green"
    assert "toe" not in found.sentence


def test_a_rotor_that_no_file_holds_is_no_unit_on_a_circle() -> None:
    """One frequency: its torque, and friction, follow those of the file."""
    t = np.arange(3000) / RATE
    angle = np.pi * t[:, None] / 3.0 + np.array([0.0, 0.5 * np.pi, 1.0])
    q, qd, qdd = np.sin(angle), np.cos(angle) * np.pi / 3.0, -np.sin(angle) * (np.pi / 3.0) ** 2
    seen = commanded(Log(t, {}, {}, "made").put(Q, q).put(COMMAND, command_of(q, qd, 8.0 * qdd)))
    assert seen is not None
    assert seen.command is not None
    torque = command_of(seen.q, 0.0 * seen.qd, seen.qdd) - GRAVITY * np.sin(seen.q)
    for factor, light in ((1.0, "cannot tell"), (180.0 / np.pi, "yellow")):
        unit = replace(seen, command=factor * (seen.command - GRAVITY * np.sin(seen.q)))
        found = scale_finding(unit, torque, np.full(3, 100.0))
        assert found is not None
        assert found.light == light


@pytest.mark.parametrize(
    ("factors", "light"), [([0.5] * 3, "yellow"), ([0.7] * 3, "green"), ([0.4, 0.5, 0.7], "green")]
)
def test_factors_that_are_alike_are_worth_a_look(factors: list[float], light: str) -> None:
    """A gear ratio or a torque constant is wrong; masses are wrong one by one."""
    seen = commanded(moved())
    assert seen is not None
    assert seen.command is not None
    found = scale_finding(replace(seen, command=factors * seen.command), seen.command, np.full(3, 100.0))
    assert found is not None
    assert (found.light, found.flag) == (light, "")


def test_a_unit_shows_beside_what_is_a_joints_own() -> None:
    seen = commanded(moved())
    assert seen is not None
    assert seen.command is not None
    found = scale_finding(replace(seen, command=8.0 * seen.command), seen.command, np.full(3, 100.0))
    assert found is not None
    assert found.light == "yellow"
    assert "hip, knee and toe are 8, 8, 8 times" in found.sentence


def test_one_position_in_degrees_is_said_to_be() -> None:
    log = moved()
    (found,) = told(log.put(Q, log["q"] * [1.0, 180.0 / np.pi, 1.0])).values()
    assert "position looks like degrees" in found.sentence


def test_the_estimate_of_a_vehicle_may_drift_and_not_be_anothers() -> None:
    """Its height follows a barometer on the bench; commands act on motors, not on positions."""
    log = moved().without("command")
    qd = log["qd"].copy()
    qd[:, 2] = np.random.default_rng(0).normal(size=len(log))
    assert told(log.put(QD, qd)) == {}
    assert told(log.put(QD, log["qd"] * [1.0, 1.0, 0.13])) == {}
    assert set(told(log.put(QD, log["qd"] * 0.13))) == {"velocity"}
    assert set(told(log.put(QD, log["qd"][:, [1, 0, 2]]))) == {"velocity"}
