"""One decision over all joints and logs: what is wrong is named, what is right is not asked about."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from made_motion import COMMAND, DRY, GRAVITY, INERTIA, NAMES, RATE, Q, command_of, moved
from scipy.ndimage import gaussian_filter1d

from etude.logs import Decision, Mendable, finding_of, sign_decision
from etude.logs.checks.exact import LIKELY
from etude.logs.checks.plausibility import repaired
from etude.logs.evidence.command_signs import AS_IS, EACH, signs_of, signs_with_presliding
from etude.logs.evidence.findings import green
from etude.logs.evidence.joint_evidence import JointEvidence
from etude.logs.evidence.likelihood import ColumnEvidence, WhitenedMotion
from etude.logs.evidence.rows import DELAYS, rows_of
from etude.testing import FakeRobot
from etude.types import Array, Log

SIGNS = np.array([1.0, -1.0, 1.0])


def with_command(log: Log, command: Array) -> Log:
    return log.put(COMMAND, np.ascontiguousarray(command))


def inverted(log: Log, signs: Array | float = -1.0) -> Log:
    return with_command(log, log["command"] * signs)


def reversed_rows(log: Log) -> Log:
    return replace(log, values={name: part[::-1].copy() for name, part in log.values.items()})


def late(log: Log, seconds: float) -> Log:
    return with_command(
        log, np.column_stack([np.interp(log.t - seconds, log.t, u) for u in log["command"].T])
    )


def decided(*logs: Log, fresh: Sequence[int] | None = None, body: object = None) -> Decision:
    return sign_decision(logs, Q, body, fresh=fresh)  # type: ignore[arg-type]


WRONG: dict[str, tuple[Callable[[Log], Log], str, tuple[float, ...]]] = {
    "one sign": (lambda log: inverted(log, SIGNS), "sign", (1.0, -1.0, 1.0)),
    "all signs": (inverted, "sign", (-1.0, -1.0, -1.0)),
    "a pair": (lambda log: with_command(log, log["command"][:, [1, 0, 2]]), "swapped", (1.0, 0.0, 2.0)),
}


@pytest.mark.parametrize("seed", [0, *(pytest.param(own, marks=pytest.mark.slow) for own in (1, 2))])
def test_right_logs_are_not_asked_about(seed: int) -> None:
    log, other = moved(seed=seed), moved(seed=seed + 10)
    for logs in ((log,), (log.without("qd"),), (log, other)):
        found = decided(*logs)
        assert (found.level, found.check) == ("silent", "")
    assert (decided(log).sign_odds > 20.0).all()


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_log_is_certain_and_silent_once_repaired(name: str) -> None:
    change, check, by = WRONG[name]
    wrong = change(moved())
    found = decided(wrong)
    assert (found.level, found.check, found.by) == ("certain", check, by)
    mended = repaired(wrong, finding_of(found, NAMES, ["a.csv"]))
    np.testing.assert_array_equal(mended["command"], moved()["command"])
    assert decided(mended).level == "silent"


def test_another_order_than_a_pair_is_a_question_that_names_none() -> None:
    found = decided(with_command(moved(), moved()["command"][:, [1, 2, 0]]))
    assert (found.level, found.check) == ("ask", "swapped")
    said = finding_of(found, NAMES, ["a.csv"])
    assert "another order" in said.sentence
    assert "--repair" not in said.step


def test_all_logs_have_one_decision() -> None:
    logs = [inverted(moved(seed=seed), SIGNS) for seed in range(3)]
    found = decided(*logs)
    assert (found.level, found.check, found.logs) == ("certain", "sign", (0, 1, 2))
    assert found.by == tuple(SIGNS)
    assert "in all 3 logs" in finding_of(found, NAMES, ["a", "b", "c"]).sentence


@pytest.mark.parametrize(
    ("odd", "signs"), [(0, SIGNS), (1, -np.ones(3)), pytest.param(2, SIGNS, marks=pytest.mark.slow)]
)
def test_one_log_against_its_fellows(odd: int, signs: Array) -> None:
    logs = [moved(seed=seed) for seed in range(3)]
    logs[odd] = inverted(logs[odd], signs)
    found = decided(*logs)
    assert (found.check, found.logs, found.by) == ("sign", (odd,), tuple(signs))
    assert found.level == "certain"


def test_new_logs_are_held_against_those_before() -> None:
    logs = [moved(seed=0), *(inverted(moved(seed=seed)) for seed in (1, 2))]
    found = decided(*logs, fresh=[1, 2])
    assert (found.check, found.logs) == ("sign", (1, 2))
    # a log that was learned is not put right by a later one
    told = inverted(moved()).repaired("The sign of the commands of toe was inverted, as asked.")
    found = decided(told, moved(seed=1), fresh=[1])
    old = finding_of(found, NAMES, ["log 1", "b.csv"], [told])
    assert "only in log 1" in old.sentence
    assert "log 1 (the sign of the commands of toe was inverted, as asked)" in old.step
    assert "etude untell" in old.step


def test_an_exchanged_pair_is_found_beside_logs_that_were_told() -> None:
    wrong = with_command(moved(seed=2), moved(seed=2)["command"][:, [1, 0, 2]])
    found = decided(moved(seed=0), moved(seed=1), wrong, fresh=[2])
    assert (found.level, found.check, found.logs) == ("certain", "swapped", (2,))


def test_reversed_rows_look_like_inverted_signs_without_velocities() -> None:
    found = decided(reversed_rows(moved()).without("qd"))
    assert (found.level, found.check, found.why) == ("ask", "sign", "time")
    assert "backwards" in finding_of(found, NAMES, ["a.csv"]).sentence


def test_some_signs_in_reversed_rows_look_like_the_others_inverted() -> None:
    light = with_command(moved(), moved()["command"] - INERTIA * qdd_of(moved()))
    found = decided(inverted(reversed_rows(light), SIGNS).without("qd"))
    assert (found.level, found.check, found.why) == ("ask", "sign", "time")
    said = finding_of(found, NAMES, ["a.csv"])
    assert "--repair" not in said.step
    assert "velocities" in said.step


def qdd_of(log: Log) -> Array:
    return np.gradient(log["qd"], log.t, axis=0)


def test_signs_that_are_as_likely_name_those_in_common_and_repair_nothing() -> None:
    """One joint with friction and reversals beside two whose force a place explains as well."""
    log = moved()
    q = log["q"]
    command = log["command"].copy()
    command[:, 1:] = np.sin(q[:, 1:])
    found = decided(with_command(log, -command))
    assert (found.level, found.check, found.by) == ("ask", "sign", (-1.0, 1.0, 1.0))
    assert found.odds > 100.0 > found.ahead
    said = finding_of(found, NAMES, ["a.csv"])
    assert "of hip is very probably inverted" in said.sentence
    assert "--repair" not in said.step
    assert "a log with more reversals of knee and toe" in said.step


def test_an_exchange_is_not_told_of_joints_whose_force_the_place_explains() -> None:
    log = moved()
    command = log["command"].copy()
    command[:, 1:] = np.sin(log["q"][:, 1:])
    lights = {}
    for name, given in (("friction", log), ("place", with_command(log, command))):
        found = decided(given)
        assert found.level == "silent"
        lights[name] = {f.check: (f.light, f.sentence) for f in green(found, NAMES)}["swapped"]
    assert lights["friction"][0] == "green"
    assert lights["place"] == (
        "cannot tell",
        "The order of the commands of knee and toe cannot be determined.",
    )


def test_an_exchange_is_not_told_of_joints_that_move_alike() -> None:
    """Their signs are known, and either command fits either joint."""
    log = moved()
    q = log["q"].copy()
    q[:, 2] = q[:, 1]
    qd, qdd = np.gradient(q, log.t, axis=0), np.gradient(np.gradient(q, log.t, axis=0), log.t, axis=0)
    found = decided(with_command(log.without("qd").put(Q, q), command_of(q, qd, qdd)))
    assert found.level == "silent"
    assert (found.sign_odds >= LIKELY).all()
    assert found.exchangeable == (1, 2)


class Known(JointEvidence):
    """Evidence of one joint's signs: log odds that it is right, in all rows and in those without turns."""

    @classmethod
    def told(cls, right: float, presliding: float = 0.0) -> Known:
        rows = rows_of([moved().take(slice(0, 500))], Q)
        assert rows is not None
        joints = np.array([0])
        known = cls(rows, joints, WhitenedMotion.of(rows, joints), orders=False)
        odds = np.zeros((len(DELAYS), 1))
        parts = (odds + right, odds, odds - 99.0, odds - 99.0, odds - 99.0)
        known.__dict__["delayed"] = ColumnEvidence(*parts)
        known.__dict__["clock"] = cls.told(presliding) if presliding else known
        return known


@pytest.mark.parametrize(("all_rows", "asked"), [(0.0, True), (-5.0, True), (5.0, True), (15.0, False)])
def test_what_all_rows_say_against_a_sign_counts(all_rows: float, asked: bool) -> None:
    """With presliding friction the sign is inverted, by e^24 less its prior."""
    found = signs_with_presliding(Known.told(all_rows, -24.0), (0,), None, True)
    assert (found is not None) == asked


class Body:
    """What a model file would say of the made motion: all but friction."""

    def __init__(self, masses: float = 1.0) -> None:
        self.masses = masses

    def predict(self, log: Log) -> Array:
        q = log["q"]
        return np.asarray(self.masses * command_of(q, np.zeros_like(q), log["qdd"]))

    def static(self, log: Log) -> Array:
        return np.asarray(self.masses * GRAVITY * np.sin(log["q"]))


def test_gravity_that_is_taken_out_is_asked_about() -> None:
    left = with_command(moved(), moved()["command"] - GRAVITY * np.sin(moved()["q"]))
    found = decided(left, body=Body())
    assert (found.level, found.check) == ("ask", "gravity")
    assert abs(found.by[0]) < 0.05
    assert decided(moved(), body=Body()).level == "silent"
    assert sign_decision([left], Q, Body(), force=False).level == "silent"  # type: ignore[arg-type]


@pytest.mark.parametrize("seconds", [-0.04, pytest.param(0.04, marks=pytest.mark.slow), 0.06])
def test_commands_that_are_late_or_early_are_noted_and_shifted(seconds: float) -> None:
    wrong = late(moved(), seconds)
    found = decided(wrong)
    assert (found.level, found.check) == ("note", "delay")
    assert found.by == pytest.approx((seconds,), abs=0.003)
    mended = repaired(wrong, finding_of(found, NAMES, ["a.csv"]))
    assert decided(mended).level == "silent"
    rows = slice(200, -200)
    right = np.interp(mended.t, moved().t, moved()["command"][:, 0])
    # commands change by 100 N m/s at most: 3 ms of them
    np.testing.assert_allclose(mended["command"][rows, 0], right[rows], atol=0.3)


@pytest.mark.parametrize("joint", [1, *(pytest.param(own, marks=pytest.mark.slow) for own in (0, 2))])
def test_commands_of_one_joint_that_are_late_are_asked_about(joint: int) -> None:
    """Its drive reports later than those of the others; no model file tells it."""
    one = np.arange(len(NAMES)) == joint
    wrong = with_command(moved(), np.where(one, late(moved(), 0.08)["command"], moved()["command"]))
    found = decided(wrong)
    assert (found.level, found.check, found.by[1:]) == ("ask", "delay", (joint,))
    assert found.by[0] == pytest.approx(0.08, abs=0.02)
    said = finding_of(found, NAMES, ["a.csv"])
    assert f"commands of {NAMES[joint]} alone are" in said.sentence
    assert said.flag == "delay"
    assert not isinstance(said, Mendable)


def rough(log: Log, size: float) -> Log:
    """Its commands with slow noise, N m."""
    noise = gaussian_filter1d(np.random.default_rng(0).normal(size=log["command"].shape), 10, axis=0)
    return with_command(log, log["command"] + size * noise / noise.std())


def test_a_delay_is_asked_about_where_little_tells_it() -> None:
    found = decided(rough(late(moved(), 0.06), 0.17))
    assert (found.level, found.check) == ("ask", "delay")
    assert found.by == pytest.approx((0.06,), abs=0.005)


def test_friction_that_turns_before_the_joint_does_is_no_delay() -> None:
    """A joint that sticks: in a turn its friction follows the force on it, and not its velocity."""
    log = moved()
    before = np.column_stack([np.interp(log.t + 0.03, log.t, qd) for qd in log["qd"].T])
    early = DRY * (np.tanh(before / 0.05) - np.tanh(log["qd"] / 0.05))
    assert decided(rough(with_command(log, log["command"] + early), 0.05)).level == "silent"


def presliding(distance: float) -> Log:
    """Its friction turns round over a distance, rad, and not in a moment (Dahl 1968); backward Euler."""
    log, held = moved(), np.zeros(3)
    friction = np.empty_like(log["qd"])
    for i, step in enumerate(log["qd"] / RATE / distance):
        held = friction[i] = (held + step) / (1.0 + np.abs(step))
    return with_command(log, log["command"] + DRY * (friction - np.tanh(log["qd"] / 0.05)))


@pytest.mark.parametrize(
    "distance", [0.016, *(pytest.param(far, marks=pytest.mark.slow) for far in (0.002, 0.004, 0.008))]
)
def test_friction_that_turns_round_over_a_distance_is_no_delay(distance: float) -> None:
    """By friction that turns in a moment it is 60 to 190 ms late, with odds of e^260 and more."""
    log = presliding(distance)
    assert decided(log).level == "silent"
    found = decided(late(log, 0.06))
    assert (found.level, found.check) == ("note", "delay")
    # of 8 and 16 mrad 3 and 7 ms remain: any sum of distances is tried
    assert found.by == pytest.approx((0.06,), abs=0.008)


def test_a_sign_that_turns_blur_is_told_beside_them() -> None:
    """All rows leave it open: log odds of 0.1, where rows without turns have more than 1,000."""
    found = decided(inverted(presliding(0.016), np.array([-1.0, 1.0, 1.0])))
    assert (found.level, found.check, found.by) == ("ask", "sign", (-1.0, 1.0, 1.0))


def test_commands_that_are_late_by_much_are_asked_about_and_never_shifted_unasked() -> None:
    wrong = late(moved(), 0.15)
    found = decided(wrong)
    assert (found.level, found.check) == ("ask", "delay")
    assert found.by == pytest.approx((0.15,), abs=0.005)
    assert decided(repaired(wrong, finding_of(found, NAMES, ["a.csv"]))).level == "silent"


@pytest.mark.parametrize("lag", [0.02, pytest.param(-0.02, marks=pytest.mark.slow)])
def test_signs_and_order_are_judged_in_step_with_the_motion(lag: float) -> None:
    """A delay too short to be said would make them doubtful."""
    log = moved()
    right = decided(late(log, lag))
    assert right.level == "silent"
    # without noise a delay 2 ms off fits as well as the true one, and its signs are a little better known
    np.testing.assert_allclose(right.sign_odds, decided(log).sign_odds, rtol=0.1)
    told, crossed = moved(seed=1), with_command(log, log["command"][:, [1, 0, 2]])
    # exchanged columns do not tell a delay of 20 ms by themselves, so the odds differ
    found = decided(told, late(crossed, lag), fresh=[1])
    assert (found.level, found.check, found.by) == ("certain", "swapped", (1.0, 0.0, 2.0))


def without_friction(seconds: float, seed: int, rate: float = 50.0) -> Log:
    """What the fake robot logs of sines that begin and end at rest: the mean command of the cycle before."""
    t, rng = np.arange(int(seconds * rate)) / rate, np.random.default_rng(seed)
    angles, q = 2.0 * np.pi * t[:, None] / seconds, np.zeros((len(t), 2))
    for k in range(1, 6):
        a, b = 0.25 * rng.normal(size=(2, 2))
        q += a * np.sin(k * angles) + b * (np.cos(k * angles) - 1.0)
    ends = np.clip([t, seconds - t], 0.0, 1.0)
    q *= np.prod(ends**3 * (10.0 - 15.0 * ends + 6.0 * ends**2), axis=0)[:, None]
    qd = np.gradient(q, t, axis=0)
    robot, rows = FakeRobot(rate=rate, seed=seed), []
    robot.ready("feedback")
    for asked in zip(q, qd, np.gradient(qd, t, axis=0), strict=True):
        rows.append(robot.state())
        robot.send(*asked, None)
    log = Log(np.array([row.t for row in rows]), {}, {}, "made")
    joints = {"parts": robot.joints, "units": ("rad",) * 2}
    log = log.put(replace(Q, **joints), np.array([row.q for row in rows]))
    return log.put(replace(COMMAND, parts=robot.joints), np.array([row.command for row in rows]))


@pytest.mark.parametrize(("seconds", "seed"), [(8.0, 0), (10.0, 4)])
def test_a_robot_without_friction_half_a_cycle_late_is_not_inverted(seconds: float, seed: int) -> None:
    """Too large a shift looks like friction that drives the joints."""
    log = without_friction(seconds, seed)
    assert sign_decision([log], log.channels["q"]).level == "silent"


@pytest.mark.parametrize("seconds", [0.06, pytest.param(-0.06, marks=pytest.mark.slow)])
def test_a_slow_log_before_it_hides_no_delay(seconds: float) -> None:
    """One model of both lacks more of friction than a delay takes."""
    slow, fast = moved(100.0, seed=1, pace=0.1), late(moved(seed=2), seconds)
    found = decided(slow, fast, fresh=[1])
    assert (found.level, found.check, found.logs) == ("note", "delay", (1,))
    assert found.by == pytest.approx((seconds,), abs=0.003)
    assert decided(slow, moved(seed=2), fresh=[1]).level == "silent"


@pytest.mark.slow
def test_logs_told_together_have_each_its_own_delay() -> None:
    slow, late_ones = moved(100.0, seed=1, pace=0.1), [late(moved(seed=seed), 0.06) for seed in (2, 3)]
    found = decided(late_ones[0], slow, late_ones[1])
    assert (found.level, found.check, found.logs) == ("note", "delay", (0, 2))
    assert found.by == pytest.approx((0.06,), abs=0.003)
    far = decided(slow, late(moved(seed=2), 0.2))
    assert (far.level, far.check, far.logs) == ("ask", "delay", (1,))
    assert far.by[0] == pytest.approx(0.2, abs=0.0101)  # half a step between delays, which are 20 ms apart
    every = decided(*(late(moved(seed=seed), 0.06) for seed in (2, 3)))
    assert (every.check, every.logs) == ("delay", (0, 1))


def test_a_delay_beyond_all_that_is_tried_is_not_called_none() -> None:
    found = decided(late(moved(), 1.1))
    assert found.check != "delay"
    said = {one.check: one.light for one in green(found, NAMES)}
    assert found.level != "silent" or said["delay"] == "cannot tell"


def test_a_circle_with_friction_is_not_asked_about() -> None:
    """One sine for each joint: a force that depends on the place may take as much power as friction."""
    t = np.arange(3000) / RATE
    angle = 2.0 * np.pi * t[:, None] / 6.0 + np.array([0.0, 0.5 * np.pi, 1.0])
    q, qd = np.sin(angle), np.cos(angle) * 2.0 * np.pi / 6.0
    turning = -3.0 * q[:, [1, 2, 0]]
    command = command_of(q, qd, -q * (2.0 * np.pi / 6.0) ** 2) + turning
    assert decided(Log(t, {}, {}, "made").put(Q, q).put(COMMAND, command)).level == "silent"


@pytest.mark.parametrize("moving", [0, 2])
def test_a_joint_that_barely_moves_has_no_say(moving: int) -> None:
    log = moved()
    q = np.where(np.arange(3) == moving, log["q"], 0.3 + 1e-3 * log["q"])
    found = decided(inverted(log.put(Q, q).without("qd"), np.where(np.arange(3) == moving, 1.0, -1.0)))
    assert found.level == "silent"
    assert found.moving.tolist() == [j == moving for j in range(3)]


def test_nothing_is_said_of_a_moment() -> None:
    assert not decided(moved(1.2)).moving.any()
    assert decided(moved().take(slice(0, 60))).level == "silent"


def test_the_best_signs_are_those_of_all_sets() -> None:
    """Against all 2^m sets in each group, added up one by one."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        as_is, turned = rng.normal(0.0, 4.0, 3), list(rng.normal(0.0, 4.0, (2, 3)))
        priors = [(0.03, 0.07), (0.02, 0.02)]
        weights: dict[tuple[int, tuple[bool, ...]], float] = {(-1, (False,) * 3): np.log(AS_IS) + as_is.sum()}
        for g, (own, (every, some)) in enumerate(zip(turned, priors, strict=True)):
            for chosen in product([False, True], repeat=3):
                prior = some * np.prod(np.where(chosen, EACH, 1.0 - EACH)) + every * all(chosen)
                key = (g if any(chosen) else -1, chosen)
                value = np.log(prior) + np.where(chosen, own, as_is).sum()
                weights[key] = float(np.logaddexp(weights.get(key, -np.inf), value))
        best = max(weights, key=lambda key: weights[key])
        found = signs_of(as_is, turned, priors)
        assert (found.group, tuple(found.turned)) == best
        none = weights[(-1, (False,) * 3)]
        assert found.odds == pytest.approx(weights[best] - none)
        rest = np.logaddexp.reduce([value for key, value in weights.items() if key != best])
        assert weights[best] - rest - np.log(2.0) < found.ahead < weights[best] - rest + 1e-9


@pytest.mark.parametrize("why", ["", "time"])
def test_a_model_file_is_asked_for_only_where_there_was_none(why: str) -> None:
    none, some = np.zeros(2), np.ones(2, dtype=bool)
    own = Decision("ask", none, some, ~some, "sign", (0,), (1.0, -1.0), odds=20.0, ahead=2.0, why=why)
    alone, beside = (
        finding_of(replace(own, positions=p), ("hip", "knee"), ["a.csv"]).step for p in (0.0, -200.0)
    )
    assert "model file with masses" in alone
    assert "model file" not in beside
    assert "log with " in beside
