"""The evidence of a command's sign: exact orthants, and figures of real logs.

The figures under `plain` were made by another implementation, without stands and Stribeck's friction. Its
filter is digital and of finite differences; that of `logs.evidence.rows` has the same gain in the frequency
domain, so they agree to a few parts in a hundred.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.special import log_ndtr, logsumexp
from scipy.stats import multivariate_normal

import etude
from etude.logs.evidence import likelihood
from etude.logs.evidence.joint_evidence import JointEvidence
from etude.logs.evidence.likelihood import ColumnEvidence, WhitenedMotion, least, log_orthant
from etude.logs.evidence.rows import AS_LOGGED, DELAYS, ORDER, FilteredRows, rows_of
from etude.types import Array, Channel, Log

RATE = 100.0
EXAMPLES = Path(__file__).parents[4] / "examples"


@cache
def example(name: str) -> Log:
    return etude.read_log(EXAMPLES / name / f"{name}_exciting.csv", EXAMPLES / name / f"{name}.toml")


def rows(name: str) -> FilteredRows:
    return rows_with(example(name))


def rows_with(log: Log) -> FilteredRows:
    found = rows_of([log], log.channels["q"])
    assert found is not None
    return found


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Viscous and Coulomb friction alone, of one filter with the motion, which also holds in a stand."""
    monkeypatch.setattr("etude.logs.evidence.rows.GAUSSIAN", ORDER)
    monkeypatch.setattr(
        "etude.logs.evidence.rows._stands", lambda t, qd, slow: np.zeros(qd.shape, dtype=bool)
    )
    monkeypatch.setattr("etude.logs.evidence.rows.FALL", 0.0)
    monkeypatch.setattr("etude.logs.evidence.likelihood.TERMS", ((0, 1, 2), (0,)))
    grid = tuple(point for point in likelihood.GRID if not point.ripple)
    monkeypatch.setattr("etude.logs.evidence.likelihood.GRID", grid)


def own_columns(rows: FilteredRows, variants: int = 1) -> ColumnEvidence:
    """Of each joint's own column as it was logged, or in each variant."""
    own = np.arange(rows.q.shape[1])
    joints = np.repeat(own, variants)
    numbers = np.tile(np.arange(variants) if variants > 1 else [AS_LOGGED], len(own))
    return WhitenedMotion.of(rows, own).evidence(rows.command, joints, joints, numbers)


def test_two_independent_halves_are_their_product() -> None:
    (found,) = log_orthant(np.array([[-3.0, -3.0]]), np.eye(2)[None])
    assert found == pytest.approx(2.0 * log_ndtr(-3.0), abs=1e-12)
    assert found == pytest.approx(-13.21545, abs=1e-5)


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_an_orthant_is_near_the_integral(k: int) -> None:
    rng = np.random.default_rng(k)
    A = rng.normal(size=(6, k, k))
    S, m = A @ A.transpose(0, 2, 1) + 0.2 * np.eye(k), rng.normal(size=(6, k))
    exact = [np.log(multivariate_normal.cdf(mean, np.zeros(k), cov)) for mean, cov in zip(m, S, strict=True)]
    np.testing.assert_allclose(log_orthant(m, S), exact, atol=0.02)


def test_an_orthant_far_away_is_finite() -> None:
    mean = np.array([[-1e4, -3e4, 5.0], [1e8, -1e7, 1.0]])
    assert np.isfinite(log_orthant(mean, np.stack([np.eye(3), 0.5 * np.eye(3) + 0.4]))).all()


@pytest.mark.usefixtures("plain")
def test_the_evidence_of_one_joint() -> None:
    """TX40, joint 1: unrestricted, right, inverted and reversed in time."""
    found = own_columns(rows("tx40")).take(np.array([0]))
    right, inverted, back, free = (
        float(logsumexp(one)) for one in (found.right, found.inverted, found.reversed, found.free)
    )
    assert free == pytest.approx(233.8, abs=0.5)
    assert right == pytest.approx(235.9, abs=0.5)
    assert right - free == pytest.approx(3.0 * np.log(2.0), abs=0.01)  # all mass is in the orthant
    assert inverted == pytest.approx(-1158.5, rel=0.01)
    assert back == pytest.approx(-976.6, rel=0.01)


@pytest.mark.usefixtures("plain")
@pytest.mark.parametrize(
    ("name", "odds"),
    [
        ("ur10", [4577, 2324, 3603, 5337, 2507, 617]),
        ("tx40", [1381, 354, 707, 8388, 150, 364]),
        ("tiago", [1, 338, 358, -399, -262]),
    ],
)
def test_log_odds_of_signs(name: str, odds: list[float]) -> None:
    right, inverted = own_columns(rows(name)).signs()
    np.testing.assert_allclose(right - inverted, odds, rtol=0.03, atol=3.0)


@pytest.mark.parametrize(
    ("name", "right"), [("ur10", [1] * 6), ("tx40", [1] * 6), ("tiago", [1, 1, 1, -1, -1])]
)
def test_the_signs_of_real_logs(name: str, right: list[int]) -> None:
    """Two currents of the TIAGo are very probably inverted."""
    odds = np.subtract(*own_columns(rows(name)).signs())
    assert (odds * right > 6.0).all()


def stuck(seconds: float = 40.0) -> Log:
    """A joint that stands for 4 s at each end of its way, where feedback winds up to the other sign."""
    t = np.arange(int(seconds * RATE)) / RATE
    phase = (t % 10.0) / 10.0
    speed = np.where(phase < 0.1, np.sin(10.0 * np.pi * phase), 0.0)
    speed = speed - np.where((phase >= 0.5) & (phase < 0.6), np.sin(10.0 * np.pi * (phase - 0.5)), 0.0)
    wind = np.interp(phase, [0.0, 0.1, 0.5, 0.6, 1.0], [1.0, 1.0, -1.0, -1.0, 1.0])
    q, qd = np.cumsum(speed)[:, None] / RATE, speed[:, None]
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(t))
    command = np.where(np.abs(speed) > 0.02, np.sign(speed) + 0.2 * speed, wind) + noise
    channels = [
        Channel("q", ("hip",), ("rad",)),
        Channel("command", ("hip",), ("N m",), "command", acts_on="q"),
    ]
    log = (
        Log(t, {}, {}, "made").put(channels[0], q).put(replace(channels[1], required=True), command[:, None])
    )
    assert np.abs(qd).max() == pytest.approx(1.0, abs=0.01)
    return log


def test_a_joint_that_stands_may_hold_any_command() -> None:
    (found,) = rows_with(stuck()).stands
    assert found.shape[1] > 20
    moved = np.abs(rows_with(stuck()).qd[:, 0]) > 0.2
    assert np.abs(found[moved]).max() < 0.5  # the ends pass the filter
    log = stuck()
    for sign in (1.0, -1.0):
        (right,), (inverted,) = own_columns(
            rows_with(log.put(log.channels["command"], sign * log["command"]))
        ).signs()
        assert sign * (right - inverted) > 20.0


STUCK_S, STATIC = (
    0.7,
    0.3,
)  # s for which a joint sticks at a reversal; of Coulomb friction, what it takes more


def sticking(periods: tuple[float, float]) -> Log:
    """Two slow joints that stick at each reversal, while feedback winds up to the other sign, and then catch
    up: in the step of the command the speed has been zero for long.
    """
    t = np.arange(3000) / RATE
    q, command = np.zeros((2, len(t), 2))
    for j, period in enumerate(periods):
        turns, since = np.divmod(t + 0.15 * period, 0.5 * period)
        way, free = 1.0 - 2.0 * (turns % 2.0), since - STUCK_S
        angle = 2.0 * np.pi / period
        behind = (np.cos(angle * STUCK_S) - 1.0) * np.exp(-np.maximum(free, 0.0) / 0.1)
        q[:, j] = way * np.where(free < 0.0, -1.0, behind - np.cos(angle * since))
        wound = np.interp(since, [0.0, STUCK_S], [-1.0, 1.0 + STATIC])
        command[:, j] = way * np.where(free < 0.0, wound, 1.0 + STATIC * np.exp(-free / 0.15))
        command[:, j] += 0.1 * np.gradient(q[:, j], t) / angle
    command += 0.02 * np.random.default_rng(0).standard_normal(command.shape)
    path = Channel("q", ("hip", "knee"), ("rad", "rad"))
    log = Log(t, {}, {}, "made").put(path, q)
    return log.put(Channel("command", path.parts, ("N m",) * 2, "command", acts_on="q"), command)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("periods", [(12.0, 16.0), (9.0, 13.0)])
def test_a_joint_that_sticks_tells_its_sign(periods: tuple[float, float], sign: float) -> None:
    """With a speed that rings before the joint breaks away, the log odds of the first joint are 0 and 8."""
    log = sticking(periods)
    judged = JointEvidence.of(rows_with(log.put(log.channels["command"], sign * log["command"])))
    assert judged is not None
    for evidence in (judged, judged.clock):
        odds = np.subtract(*evidence.variant(AS_LOGGED).signs())
        assert (sign * odds > 100.0).all()


def rubbing(static: float = 0.0, *, fall: float = 0.0, ripple: float = 0.0, period: float = 40.0) -> Log:
    """Two joints whose static friction is so much above Coulomb's, which falls by that much at the top speed;
    and a force that ripples with the place.
    """
    t = np.arange(4000) / RATE
    q, qd = np.zeros((2, len(t), 2))
    for k, (j, size) in itertools.product((1, 2, 3), enumerate((0.5, 0.8))):
        angle = 2.0 * k * np.pi * t / period + j + k
        q[:, j] += size / k * np.sin(angle)
        qd[:, j] += size * 2.0 * np.pi / period * np.cos(angle)
    speed = np.abs(qd)
    size = 1.0 + static * np.exp(-speed / 0.2) - fall * speed / speed.max(axis=0)
    command = np.tanh(qd / 0.01) * size + ripple * np.sin(30.0 * q)
    path = Channel("q", ("hip", "knee"), ("rad", "rad"))
    log = Log(t, {}, {}, "made").put(path, q)
    return log.put(Channel("command", path.parts, ("N m",) * 2, "command", acts_on="q"), command)


@pytest.mark.parametrize("static", [0.0, 0.5, 1.5])
def test_static_friction_above_coulombs_is_no_inverted_sign(static: float) -> None:
    """It leaves a viscous term below zero, which neither sign would explain."""
    found = own_columns(rows_with(rubbing(static, period=10.0)))
    assert not found.strange().any()
    assert (np.subtract(*found.signs()) > 10.0).all()


def test_friction_that_falls_with_speed_is_explained() -> None:
    found = own_columns(rows_with(rubbing(fall=0.5)))
    assert not found.strange().any()
    assert (np.subtract(*found.signs()) > 1000.0).all()


def test_what_ripples_with_the_place_does_not_hide_a_sign() -> None:
    assert (np.subtract(*own_columns(rows_with(rubbing(ripple=0.5))).signs()) > 200.0).all()


def test_an_inverted_command_has_the_opposite_odds() -> None:
    log = example("tx40")
    turned = rows_with(log.put(log.channels["command"], -log["command"]))
    for own, other in zip(own_columns(turned).signs(), own_columns(rows("tx40")).signs()[::-1], strict=True):
        np.testing.assert_allclose(own, other, atol=1e-6)


def test_no_unit_matters() -> None:
    log = example("tx40")
    times = rows_with(log.put(log.channels["command"], 1e-3 * log["command"]))
    np.testing.assert_allclose(own_columns(times).right, own_columns(rows("tx40")).right, atol=1e-6)


def test_the_curve_of_delays() -> None:
    """UR10: the log is nearest to 20 ms, and falls on both sides."""
    whole = own_columns(rows("ur10"), len(DELAYS)).whole().reshape(-1, len(DELAYS)).sum(axis=0)
    curve = whole - 100.0 * np.abs(DELAYS)
    assert DELAYS[int(curve.argmax())] == 0.02
    best = int(curve.argmax())
    assert (np.diff(curve)[:best] > 0.0).all()
    assert (np.diff(curve)[best:] < 0.0).all()


def test_the_least_odds_are_those_of_classes_that_have_a_say() -> None:
    one = np.array([[10.0, 3.0, -90.0], [5.0, 0.0, -np.inf], [0.0, -np.inf, -np.inf]])
    other = np.array([[2.0, 1.0, 0.0], [9.0, -2.0, -np.inf], [-np.inf, -60.0, -np.inf]])
    found: Array = least(one, other)
    assert found.tolist() == [0.0, 0.0, 100.0]  # the first two differ in sign, the third is FAR below -60
    assert least(one[:, :2], other[:, :2]).tolist() == [2.0, 0.0, 100.0]
