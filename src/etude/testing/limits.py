"""What every limit owes: the search keeps what the proof wants, and the proof holds what runs measure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from etude.protocols import Family, Limit
from etude.testing.differences import central, close
from etude.types import Array, Cone, Proof

PERIODS = 20_001
"""Instants at which a proof is held against what the limit measures."""
SLACK = 0.03
"""A proof may exceed what is reached by this part of the limit's width, and no more."""


class LimitSuite:
    """Laws of `protocols.Limit`. Set `limit`, `family`, and `home`, a pose (k,) well inside."""

    limit: ClassVar[Limit]
    family: ClassVar[Family]
    home: ClassVar[Array]
    tight: ClassVar[bool] = True
    """False for a limit whose cones are narrower than itself (a tilt asked of both signs)."""

    def test_what_the_cones_admit_is_proved(self) -> None:
        for seed in range(6):
            family, p = self._edge(seed, 1.0)
            if not self.limit.cones(family):
                return  # nothing is admitted by cones
            rows = self.limit.prove(family.trajectory(p))
            margins = [_room(row) for row in rows if row.status == "proved"]
            assert margins, "the limit proves nothing"
            assert min(margins) >= 0.0, f"admitted by the cones, refused by the proof: {rows}"

    def test_three_per_cent_beyond_is_refused(self) -> None:
        if not self.tight:
            return
        for seed in range(6):
            family, p = self._edge(seed, 1.03)
            if not self.limit.cones(family):
                return
            rows = self.limit.prove(family.trajectory(p))
            assert min(_room(row) for row in rows) < 0.0, "3 % beyond the limit, and still proved"

    def test_the_proof_holds_what_is_measured(self) -> None:
        for seed in range(3):
            family, p = self._edge(seed, 0.9)
            trajectory = family.trajectory(p)
            rows = self.limit.prove(trajectory)
            t = np.linspace(0.0, trajectory.duration, PERIODS)
            measured = self.limit.of_motion(trajectory.motion(t, 4))
            assert measured.shape == (PERIODS, len(rows)), "of_motion has one column for each row of prove"
            for row, values in zip(rows, measured.T, strict=True):
                self._holds(row, values)

    def _holds(self, row: Proof, values: Array) -> None:
        width = row.upper - row.lower
        size = width if np.isfinite(width) else max(abs(row.proved_lower), abs(row.proved_upper))
        name = f"{row.quantity} of {row.axis}"
        assert values.max() <= row.proved_upper + 1e-9 * size, f"{name} reaches more than is proved"
        assert values.min() >= row.proved_lower - 1e-9 * size, f"{name} reaches less than is proved"
        if self.tight:
            assert row.proved_upper <= values.max() + SLACK * size, f"the proof of {name} is loose"
            least = -values.max() if row.proved_lower == -row.proved_upper else values.min()  # of a size
            assert row.proved_lower >= least - SLACK * size, f"the proof of {name} is loose"

    def test_the_penalty_has_its_gradient(self) -> None:
        family, p = self._edge(0, 1.05)
        t = family.trajectory(p).duration * np.linspace(0.05, 0.95, 5)
        motion = family.motion(p, t, 3)
        found = self.limit.penalty(motion)
        if found is None:
            return
        value, gradient = found

        def of_orders(orders: Array) -> float:
            again = self.limit.penalty(type(motion)(t, orders))
            assert again is not None
            return again[0]

        assert value >= 0.0
        close(gradient, central(of_orders, motion.orders, 1e-5), 1e-5, "gradient of the penalty")

    def test_home_is_inside(self) -> None:
        family = self.family.drawn(np.random.default_rng(0))
        rows = self.limit.prove(family.trajectory(_resting(family, self.home)))
        assert all(_room(row) >= 0.0 for row in rows if row.status == "proved"), "home is outside the limit"

    def _edge(self, seed: int, part: float) -> tuple[Family, Array]:
        """A drawn family and parameters in a random direction from home, `part` of the way to the edge."""
        rng = np.random.default_rng(seed)
        family = self.family.drawn(rng)
        centre = _resting(family, self.home)
        direction = rng.standard_normal(family.size)
        cones = self.limit.cones(family)
        reach = min((_reach(cone, centre, direction) for cone in cones), default=1.0)
        return family, centre + part * reach * direction


def _resting(family: Family, home: Array) -> Array:
    """Parameters (P,) nearest to standing still at `home`, by least squares on the path."""
    t = np.linspace(0.0, family.trajectory(np.zeros(family.size)).duration, 4 * family.size + 1)
    zero = family.motion(np.zeros(family.size), t, 1).orders[0]
    columns = [family.motion(e, t, 1).orders[0] - zero for e in np.eye(family.size)]
    A = np.stack([column.ravel() for column in columns], axis=1)
    found, *_ = np.linalg.lstsq(A, (home - zero).ravel(), rcond=None)
    return np.asarray(found)


def _reach(cone: Cone, centre: Array, direction: Array) -> float:
    """Largest s with centre + s direction inside the cone, by bisection."""
    u, w = cone.rows @ centre + cone.offset, cone.rows @ direction
    reach, slope = (1.0, 0.0) if cone.slope is None else (1.0 + cone.slope @ centre, cone.slope @ direction)

    def inside(s: float) -> bool:
        return bool(np.all(np.sqrt(((u + s * w) ** 2).sum(axis=0)) <= reach + s * slope))

    low, high = 0.0, 1.0
    while inside(high) and high < 1e9:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if inside(middle) else (low, middle)
    return low


def _room(row: Proof) -> float:
    """What is left between the proved interval and the limit, a row's less its margin; negative: not kept."""
    return min(row.upper - row.proved_upper, row.proved_lower - row.lower)


def worst(rows: Sequence[Proof]) -> float:
    """Least room over all rows."""
    return min(_room(row) for row in rows)
