"""Commands along a motion: what rows say against dense samples, slack, deviation, penalty, and who cannot."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from etude.errors import UsageError
from etude.limits import CommandLimit, certify, slack
from etude.limits.certificate import COMMANDS
from etude.limits.commands import (
    AMPLE,
    CLOSE,
    COARSE,
    FEW,
    LOOK,
    SELDOM,
    SPACING,
    OpenCommands,
    by_model,
    kept_at,
)
from etude.trajectories import FourierTrajectory, Splined
from etude.types import Array, Motion

NAMES = ("a", "b")


def pendulum(motion: Motion) -> Array:
    """Inertia, gravity, and a friction that turns round within a tenth of a second."""
    q, qd, qdd = motion.orders[:3]
    return np.asarray(0.7 * qdd + 4.0 * np.sin(q) + 2.0 * np.tanh(qd / 0.05))


LIMIT = CommandLimit(
    "torque",
    ("N m", "N m"),
    NAMES,
    -np.full(2, 8.0),
    np.full(2, 8.0),
    np.full(2, np.inf),
    pendulum,
    None,
    "a formula",
)
RATED = replace(LIMIT, rate=np.array([60.0, np.inf]), _proofs={})
SWING = FourierTrajectory(np.array([[0.1, -0.3], [0.5, 0.2], [0.3, -0.4]]), 0.9, 7.0)


def dense(motion: FourierTrajectory, times: int) -> tuple[Array, Array]:
    t = np.linspace(0.0, motion.duration, times * round(motion.duration / SPACING) + 1)
    values = pendulum(motion.motion(t, 3))
    return values, np.diff(values, axis=0) / np.diff(t)[:, None]


def test_rows_hold_what_a_hundred_times_as_many_samples_show() -> None:
    values, rates = dense(SWING, 100)
    torque, other, rate = RATED.prove(SWING)
    for row, own in ((torque, values[:, 0]), (other, values[:, 1])):
        assert row.proved_lower <= own.min()
        assert own.max() <= row.proved_upper <= own.max() + 0.01, "and say little more"
    most = np.abs(rates[:, 0]).max()
    assert most <= rate.proved_upper <= 1.3 * most
    assert {row.status for row in (torque, other, rate)} == {"sampled"}
    assert "5 ms of a formula" in torque.method
    assert (rate.axis, rate.quantity, rate.upper) == ("a", "torque rate", 60.0)
    assert RATED.of_motion(SWING.motion(np.linspace(0.0, 7.0, 50))).shape == (50, 3)


def test_a_certificate_says_that_commands_are_looked_at_and_what_is_left_open() -> None:
    found = certify(SWING, [replace(LIMIT, gaps=("Friction is not in it.",))])
    assert COMMANDS not in found.not_verified
    assert "Friction is not in it." in found.not_verified
    assert found.ok == bool(min(map(slack, found.rows)) >= 0.0)
    weak = replace(LIMIT, upper=np.full(2, 0.5), lower=-np.full(2, 0.5), _proofs={})
    assert not certify(SWING, [weak]).ok


def test_deviations_count_as_often_as_all_commands_need() -> None:
    """b for 28 independent ones at 95 %: 1 - 0.05/56 = Phi(3.1235)."""

    def deviation(motion: Motion) -> Array:
        return np.stack([0.1 + 0.0 * motion.t, 0.1 * motion.t], axis=1)

    known = replace(LIMIT, deviation=deviation, _proofs={})
    assert known.beyond(7.0) == pytest.approx(3.1235, abs=1e-3)
    plain, wide = LIMIT.prove(SWING)[0], known.prove(SWING)[0]
    assert wide.proved_upper == pytest.approx(plain.proved_upper + 0.31235, abs=1e-3)
    assert "3.1 of its deviations" in wide.method
    spread = known.spread(SWING.motion(np.linspace(0.0, 7.0, 1401)), 7.0)[:, 1]
    t = np.linspace(0.0, 7.0, 1401)
    assert np.all(spread >= 3.1 * 0.1 * t - 1e-9), "never less than it is there"
    assert np.all(spread <= 3.13 * 0.1 * (t + COARSE) + 1e-9)


def test_the_penalty_is_zero_inside_and_has_its_gradient_outside() -> None:
    t = np.linspace(0.2, 6.8, 30)
    motion = SWING.motion(t)
    assert replace(LIMIT, upper=np.full(2, 50.0), lower=-np.full(2, 50.0)).penalty(motion)[0] == 0.0
    weak = replace(LIMIT, upper=np.full(2, 2.0), lower=-np.full(2, 2.0))
    value, gradient = weak.penalty(motion)
    assert value > 0.0
    rng = np.random.default_rng(0)
    for _ in range(5):
        way = 1e-5 * rng.standard_normal(motion.orders.shape)
        ends = [weak.penalty(Motion(t, motion.orders + sign * way))[0] for sign in (-1.0, 1.0)]
        assert (gradient * way).sum() == pytest.approx(0.5 * (ends[1] - ends[0]), rel=1e-3)


def test_searches_ask_what_the_proof_will_say() -> None:
    most = max(row.proved_upper for row in LIMIT.prove(SWING))
    for part, kept in ((1.05, True), (0.9, False)):
        own = replace(LIMIT, upper=np.full(2, part * most), lower=-np.full(2, 20.0), _proofs={})
        assert own.keeps(SWING) == kept
        assert certify(SWING, [own]).ok == kept


def test_what_few_samples_exceed_no_proof_holds() -> None:
    spread = replace(LIMIT, deviation=lambda motion: 0.1 * np.abs(motion.orders[1]), _proofs={})
    (least, most), _ = ((row.proved_lower, row.proved_upper) for row in spread.prove(SWING))
    told = {}
    for low, high in itertools.product((0.8, 0.97, 1.001, 1.5), repeat=2):
        ends = {"lower": np.array([low * least, -99.0]), "upper": np.array([high * most, 99.0])}
        own = replace(spread, **ends, _proofs={})
        told[low, high] = own.violated(SWING)
        assert not told[low, high] or not certify(SWING, [own]).ok
    assert told[0.8, 1.5]
    assert told[1.5, 0.8]
    assert not told[1.001, 1.001]


def test_a_proof_that_fails_shows_where_the_next_one_will() -> None:
    spread = replace(LIMIT, deviation=lambda motion: 0.1 * np.abs(motion.orders[1]), _proofs={}, _broken={})
    most, lower = spread.prove(SWING)[0].proved_upper, np.full(2, -99.0)
    short, enough = (
        replace(spread, lower=lower, upper=np.array([most * part, 99.0]), _proofs={})
        for part in (1.0 - 1e-6, 1.0 + 1e-6)
    )
    assert not short.violated(SWING), "few samples do not tell"
    assert not certify(SWING, [short]).ok
    assert short.violated(SWING), "the worst of all samples does, counted as the proof counts it"
    assert not enough.violated(SWING)
    assert certify(SWING, [enough]).ok


def test_a_first_look_passes_only_what_is_far_inside() -> None:
    """It may only say what the closer look says too, and asks so few samples that it pays."""
    asked: list[int] = []

    def both(motion: Motion) -> tuple[Array, Array]:
        asked.append(len(motion.t))
        return pendulum(motion), np.full((len(motion.t), 2), 0.05)

    long = SWING.slowed(6.0)
    t = np.linspace(0.0, long.duration, 4201)
    largest = np.abs(pendulum(long.motion(t, 3))).max() + LIMIT.beyond(long.duration) * 0.05
    for part, closer in ((1.0 / (AMPLE - 0.01), False), (1.0 / (AMPLE + 0.05), True)):
        counts: list[int] = []
        own = replace(
            LIMIT,
            lower=-np.full(2, part * largest),
            upper=np.full(2, part * largest),
            mean=lambda motion, counts=counts: (counts.append(len(motion.t)), pendulum(motion))[1],
            deviation=lambda motion: both(motion)[1],
            both=both,
            _proofs={},
        )
        asked.clear()
        assert own.keeps(long)
        assert asked[0] == FEW + 1
        assert bool(counts) == closer, "what is nearer is looked at closely"
    assert not replace(own, upper=np.full(2, 0.9 * largest), lower=-np.full(2, 0.9 * largest)).keeps(long)
    for bound, needed in ((0.05, []), (50.0, [FEW + 1])):
        asked.clear()
        far = replace(own, upper=np.full(2, 2.0 * largest), lower=-np.full(2, 2.0 * largest))
        known = replace(far, at_most=lambda m, b=bound: (pendulum(m), np.full((len(m.t), 2), b)))
        assert known.keeps(long)
        assert asked == needed, "deviations are asked only where what they are at most leaves it open"
    for part in (0.9, 0.6):  # of the mean with its deviations, and of less than the mean alone
        counts.clear()
        narrow = replace(own, upper=np.full(2, part * largest), lower=-np.full(2, part * largest))
        assert not narrow.keeps(long)
        assert not counts, "what few samples exceed needs no closer look"
    short = replace(own, both=None, mean=pendulum, deviation=None)
    asked.clear()
    assert short.keeps(SWING)
    assert not asked, "a short motion has no more samples than the first look"


def test_a_closer_look_takes_the_deviations_of_the_first_one() -> None:
    """At 15 s both look every .2 s. Deviations of neighbours differ, so others would change verdicts."""
    asked: list[int] = []

    def deviation(motion: Motion) -> Array:
        asked.append(len(motion.t))
        return np.repeat(0.05 + 0.02 * np.cos(40.0 * motion.t)[:, None], 2, axis=1)

    own = replace(LIMIT, deviation=deviation, both=lambda m: (pendulum(m), deviation(m)), _proofs={})
    piece, verdicts = SWING.slowed(15.0 / SWING.duration), []
    looked = own.along(piece, LOOK)
    most = np.abs(pendulum(looked)) + own.spread(looked, 15.0, SELDOM)
    for part in (0.995, 0.999, 1.001, 1.005, 1.1):
        end = part * np.full(2, most.max()) / CLOSE
        asked.clear()
        verdicts.append(replace(own, upper=end, lower=-end, _witness={}).keeps(piece))
        assert asked == [FEW + 1], "once"
    assert verdicts == [False, False, True, True, True]
    longer = SWING.slowed(20.0 / SWING.duration)
    asked.clear()
    assert replace(own, upper=end, lower=-end, _witness={}).keeps(longer)
    assert len(asked) == 2, "other instants are asked anew"


def test_a_search_asks_for_deviations_only_where_the_most_of_them_would_be_too_much() -> None:
    asked = []

    def deviation(motion: Motion) -> Array:
        asked.append(len(motion.t))
        return np.full((len(motion.t), 2), 0.05)

    motion = SWING.motion(np.linspace(0.2, 6.8, 30))
    wide = replace(LIMIT, deviation=deviation, most=np.full(2, 0.1), _proofs={})
    largest = np.abs(wide.mean(SWING.motion(np.linspace(0.0, 7.0, 1401)))).max()
    for room, asks in ((4.0, False), (0.25, True)):  # b is 3.12: 0.31 of most, 0.16 of what there is
        ends = np.full(2, (largest + room) / CLOSE)
        own = replace(wide, upper=ends, lower=-ends, _proofs={})
        plain = replace(own, most=None)
        asked.clear()
        assert own.keeps(SWING)
        assert own.penalty(motion)[0] == 0.0
        assert bool(asked) == asks, room
        assert plain.keeps(SWING)
    narrow = replace(wide, upper=np.full(2, 2.0), lower=-np.full(2, 2.0), _proofs={})
    value, gradient = narrow.penalty(motion)
    plainly = replace(narrow, most=None).penalty(motion)
    assert value == plainly[0] > 0.0
    np.testing.assert_array_equal(gradient, plainly[1])


def test_a_model_whose_mean_is_doubted_is_asked_in_full() -> None:
    inputs = SimpleNamespace(states=lambda motion: motion.orders[0], orders=3)
    ends = -np.full(2, 9.0), np.full(2, 9.0)
    for least, known in ((None, True), (np.ones(2), False)):
        asked = dict.fromkeys(("posterior", "mean", "at_most"), lambda _: pytest.fail("not asked here"))
        model = SimpleNamespace(inputs=inputs, prior_deviation=np.ones(2), least=least, **asked)
        limit = by_model(model, "torque", ("N m", "N m"), NAMES, ends, np.full(2, np.inf))  # type: ignore[arg-type]
        assert (limit.most is not None) == known


def test_where_rest_at_home_is_beyond_it_nothing_is_looked_at_and_it_says_why() -> None:
    weak = replace(LIMIT, upper=np.full(2, 1.0), lower=-np.full(2, 1.0))
    assert kept_at(weak, np.zeros(2)) is weak
    found = kept_at(weak, np.array([0.0, 1.2]))
    assert isinstance(found, OpenCommands)
    certificate = certify(SWING, [found])
    assert not certificate.rows
    assert "3.73 N m for b at rest at home" in " ".join(certificate.not_verified)
    vague = replace(LIMIT, deviation=lambda motion: np.full((len(motion.t), 2), 2.1))
    assert vague.spread(SWING.motion(np.zeros(1)), 1.0).max() < 8.0
    assert isinstance(kept_at(vague, np.zeros(2)), OpenCommands), "a longer motion needs more deviations"


def test_a_model_is_asked_along_the_plan() -> None:
    def predict(log: Array) -> tuple[Array, Array]:
        return 2.0 * log, np.full_like(log, 0.04)

    inputs = SimpleNamespace(states=lambda motion: motion.orders[0], orders=3)
    model = SimpleNamespace(inputs=inputs, posterior=predict)
    ends = -np.full(2, 9.0), np.full(2, 9.0)
    limit = by_model(model, "torque", ("N m", "N m"), NAMES, ends, np.full(2, np.inf))  # type: ignore[arg-type]
    row = limit.prove(SWING)[0]
    path = SWING.motion(np.linspace(0.0, 7.0, 7001), 1).orders[0][:, 0]
    assert row.proved_upper == pytest.approx(2.0 * path.max() + 0.2 * limit.beyond(7.0), abs=1e-3)


def test_curves_without_accelerations_are_refused() -> None:
    lines = Splined(np.array([0.0, 1.0]), np.zeros((1, 2, 2)))
    for piece in (lines, replace(lines, held=True, points=np.zeros((3, 2, 2)))):
        with pytest.raises(UsageError):
            LIMIT.prove(piece)
    assert math.isfinite(LIMIT.prove(replace(lines, points=np.zeros((3, 2, 2))))[0].proved_upper)


@pytest.mark.parametrize("seed", range(6))
def test_a_motion_that_failed_fails_again_at_the_instants_of_its_largest_excess(seed: int) -> None:
    """Friction needs the direction, so instants alone must not miss it; other scales are judged alike."""
    rng = np.random.default_rng(seed)

    def deviation(motion: Motion) -> Array:
        return np.asarray(0.05 + 0.02 * np.abs(motion.orders[0]))

    def both(motion: Motion) -> tuple[Array, Array]:
        return pendulum(motion), deviation(motion)

    amplitudes = rng.normal(scale=0.5, size=(5, 2))
    for duration in (7.0, 60.0):  # without a first look and with one

        def scaled(scale: float, duration: float = duration) -> FourierTrajectory:
            return FourierTrajectory(scale * amplitudes, 0.9, duration)

        ends = np.full(2, 5.0)
        limit = replace(
            LIMIT, lower=-ends, upper=ends, deviation=deviation, both=both, _proofs={}, _witness={}
        )
        scales = np.linspace(0.0, 3.0, 31)[1:]
        assert not limit.fails_again(scaled(3.0)), "nothing has failed yet"
        kept = np.array([limit.keeps(scaled(scale)) for scale in scales])
        assert 0 < kept.sum() < len(kept)
        least = scales[~kept][0]
        assert not limit.keeps(scaled(least))
        assert limit.fails_again(scaled(least))
        for scale, is_kept in zip(scales, kept, strict=True):
            assert not (is_kept and limit.fails_again(scaled(scale))), "it never refuses what is kept"
