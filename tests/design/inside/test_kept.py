"""Limits that are not convex: here a disc in joint space that the arm has to go round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from design_examples import (
    arm_family,
    arm_home,
    arm_limits,
    arm_model,
    arm_point,
    assert_same,
)

from etude.design import Design, DesignConfig, NonconvexLimits, Source, design, design_objective
from etude.design.candidates import SampledPoint
from etude.design.solve import RankedCandidates
from etude.errors import UnsafeTrajectoryError
from etude.limits import certify
from etude.protocols import Family, Trajectory
from etude.testing import central
from etude.types import Cone, Motion, Proof

QUICK = DesignConfig(criterion="mean_variance", candidates=6, refine=2, steps=15, points=25)


@dataclass(frozen=True)
class Disc:
    """Positions at least `radius` from `middle`; not convex."""

    middle: tuple[float, float]
    radius: float
    name = "disc"

    def cones(self, family: Family) -> Sequence[Cone]:
        return ()

    def penalty(self, motion: Motion) -> tuple[float, np.ndarray]:
        step = motion.orders[0] - self.middle
        deep = np.maximum(self.radius**2 - (step**2).sum(axis=1), 0.0)
        gradient = np.zeros_like(motion.orders)
        gradient[0] = -4.0 * deep[:, None] * step / len(step)
        return float(np.mean(deep**2)), gradient

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        least = float(self.of_motion(piece.motion(np.linspace(0.0, piece.duration, 5001), 1)).min())
        return [Proof("arm", "disc", self.radius, np.inf, least, 9.0, "5001 samples", "sampled")]

    def of_motion(self, motion: Motion) -> np.ndarray:
        return np.linalg.norm(motion.orders[0] - self.middle, axis=1)[:, None]


DISC = Disc((0.3, 1.2), 0.3)


def run(limits, seed: int = 0) -> Design:
    model, rng = arm_model(), np.random.default_rng(seed)
    return design(arm_family(), limits, arm_home(), model.inputs, model, QUICK, rng)


def test_the_design_goes_round_what_is_not_convex() -> None:
    free = run(arm_limits())
    for seed in range(3):
        found = run((*arm_limits(), DISC), seed)
        assert certify(found.trajectory, (*arm_limits(), DISC)).ok
        assert found.value >= found.baseline
        model = arm_model()
        plan = model.inputs.plan(found.trajectory.motion(np.linspace(0.0, 30.0, 99), 3))
        assert np.ptp(plan.X[:, 0]) > 0.1
    assert not certify(free.trajectory, [DISC]).ok


def test_a_disc_that_is_far_changes_nothing() -> None:
    far = run((*arm_limits(), Disc((9.0, 9.0), 0.2)))
    assert far.trajectory.to_json() == run(arm_limits()).trajectory.to_json()


def test_the_penalty_is_zero_where_it_is_kept_and_its_gradient_right() -> None:
    family, rng = arm_family(), np.random.default_rng(1)
    at = arm_point(rng, family)
    kept = NonconvexLimits.of((*arm_limits(), DISC), family, at)
    assert kept.limits == (DISC,)
    wide = NonconvexLimits.of([Disc(DISC.middle, 0.6)], family, at)
    value, gradient = wide.penalty(family, at)
    assert value > 0.0
    assert_same(gradient, central(lambda p: wide.penalty(family, p)[0], at), 1e-5)
    assert kept.penalty(family, arm_point(rng, family, 0.0))[0] == 0.0


def test_what_is_drawn_home_ends_close_to_the_last_point_that_holds() -> None:
    family, rng = arm_family(), np.random.default_rng(1)
    home, at = arm_point(rng, family, 0.0), arm_point(rng, family, 4.0)
    kept = NonconvexLimits.of([DISC], family, at)
    found = kept.shrink_to_home(family, home, at)
    assert kept.proved(family, found)
    assert not kept.proved(family, home + 1.01 * (found - home))
    assert kept.shrink_to_home(family, home, found) is found
    said = r"home violates the limits: disc of arm is \S+, limit 0\.6"
    with pytest.raises(UnsafeTrajectoryError, match=said):
        NonconvexLimits.of([Disc(tuple(arm_home()), 0.6)], family, at).shrink_to_home(family, home, at)


@dataclass(frozen=True)
class Sampled(Disc):
    """The disc, which a few samples may show to be hit."""

    asked: tuple[list[Trajectory], list[Trajectory]] = field(default_factory=lambda: ([], []))

    def violated(self, piece: Trajectory) -> bool:
        self.asked[0].append(piece)
        return (
            float(self.of_motion(piece.motion(np.linspace(0.0, piece.duration, 99), 1)).min()) < self.radius
        )

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        self.asked[1].append(piece)
        return super().prove(piece)


def test_no_proof_is_made_of_what_samples_refute_and_the_result_is_proved() -> None:
    family, rng = arm_family(), np.random.default_rng(1)
    home, at = arm_point(rng, family, 0.0), arm_point(rng, family, 4.0)
    disc = Sampled(DISC.middle, DISC.radius)
    found = NonconvexLimits.of([disc], family, at).settled(family, home, at)
    looked, proofs = disc.asked
    assert len(looked) > len(proofs) > 0
    plain = NonconvexLimits.of([DISC], family, at)
    np.testing.assert_array_equal(found, plain.settled(family, home, at))
    assert plain.proved(family, found)
    assert not plain.proved(family, home + (found - home) * 1.01)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("seed", range(4))
def test_candidates_are_drawn_home_only_while_they_can_win(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits, model, family = (*arm_limits(), DISC), arm_model(), arm_family()
    source = Source(family, limits, arm_home(), "scaled")
    other = family.trajectory(arm_point(np.random.default_rng(9), family))
    aim = design_objective(family, model.inputs, model, QUICK, (), [other])
    candidates = source.candidates(np.random.default_rng(seed), 24)
    kept = NonconvexLimits.of(limits, family, candidates[0].p)
    home = [one.home(kept) for one in candidates]
    assert any(one is not before for one, before in zip(home, candidates, strict=True)), (
        "the disc is in the way"
    )
    every = sorted((aim.objective.value(one.p) for one in home), reverse=True)
    asked: list[SampledPoint] = []
    monkeypatch.setattr(
        SampledPoint,
        "home",
        lambda self, kept, whole=SampledPoint.home: asked.append(self) or whole(self, kept),
    )
    ranked = RankedCandidates.of(aim.objective, candidates)
    best = ranked.best(aim.objective, kept, 2)
    assert [ranked.values[place] for place in best] == every[:2], "as if all had been drawn home"
    assert 2 <= len(asked) < 24, "and not all were"
    assert all(kept.proved(family, ranked.candidates[place].p) for place in best)


@dataclass(frozen=True)
class Reach(Disc):
    """Positions at most `radius` from `middle`. It remembers the farthest instant and counts full checks."""

    full: list[Trajectory] = field(default_factory=list)
    worst: list[float] = field(default_factory=list)

    def keeps(self, piece: Trajectory) -> bool:
        self.full.append(piece)
        t = np.linspace(0.0, piece.duration, 999)
        away = self.of_motion(piece.motion(t, 1))[:, 0]
        if away.max() > self.radius:
            self.worst[:] = [float(t[away.argmax()] / piece.duration)]
        return bool(away.max() <= self.radius)

    def fails_again(self, piece: Trajectory) -> bool:
        at = np.array(self.worst) * piece.duration
        return bool(np.any(self.of_motion(piece.motion(at, 1)) > self.radius))


@dataclass(frozen=True)
class Forgetful(Reach):
    """It remembers nothing that fails."""

    def fails_again(self, piece: Trajectory) -> bool:
        return False


@pytest.mark.parametrize("seed", range(4))
def test_a_limit_that_remembers_its_worst_instant_needs_few_full_checks(seed: int) -> None:
    family, rng = arm_family(), np.random.default_rng(seed)
    home, at = arm_point(rng, family, 0.0), arm_point(rng, family, 4.0)
    shrunk, counts = [], []
    for limit in (Reach(tuple(arm_home()), 0.5), Forgetful(tuple(arm_home()), 0.5)):
        assert not limit.keeps(family.trajectory(at))
        limit.full.clear()
        kept = NonconvexLimits.of([limit], family, at)
        shrunk.append(kept.shrink_to_home(family, home, at, fast_check=True))
        counts.append(len(limit.full))
    np.testing.assert_array_equal(*shrunk)
    assert counts[0] <= 4 < 12 <= counts[1] <= 18, counts
