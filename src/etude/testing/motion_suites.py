"""Laws of families of trajectories, of each trajectory, and of limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from etude.limits.lipschitz import LipschitzLimit
from etude.plugins import required
from etude.protocols import Family, Limit, Trajectory
from etude.testing.differences import central, close, same
from etude.trajectories.json_text import from_json
from etude.types import Array, Cone, Proof


class FamilySuite:
    """Laws of `protocols.Family` and `protocols.Trajectory`.

    Set `family`, and override `draw` where not every parameter vector is a trajectory.
    """

    family: ClassVar[Family]
    orders: ClassVar[int] = 3
    instants: ClassVar[int] = 100_000

    def draw(self, seed: int) -> tuple[Family, Array]:
        """A family with everything drawn that no search refines, and parameters (P,)."""
        rng = np.random.default_rng(seed)
        return self.family.drawn(rng), rng.standard_normal(self.family.size)

    def times(self, trajectory: Trajectory, count: int) -> Array:
        """(count,) instants inside the trajectory."""
        return trajectory.duration * (np.arange(count) + 0.5) / count

    def test_parameters_come_back(self) -> None:
        family, p = self.draw(0)
        close(family.parameters(family.trajectory(p)), p, 1e-9, "parameters of the trajectory of p")

    def test_family_and_trajectory_move_alike(self) -> None:
        family, p = self.draw(1)
        trajectory = family.trajectory(p)
        t = self.times(trajectory, 50)
        close(
            family.motion(p, t, self.orders).orders, trajectory.motion(t, self.orders).orders, 1e-12, "motion"
        )

    def test_each_order_is_the_derivative_of_the_one_before(self) -> None:
        trajectory = self._trajectory(2)
        h = 1e-4 * trajectory.duration / 60.0
        t = self.times(trajectory, 301)
        here = trajectory.motion(t, self.orders).orders
        far = [trajectory.motion(t + k * h, self.orders).orders for k in (-2, -1, 1, 2)]
        slope = (far[0] - far[3] + 8.0 * (far[2] - far[1])) / (12.0 * h)
        for order in range(self.orders - 1):
            wrong = np.abs(slope[order] - here[order + 1]).max(axis=1) > 1e-5 * np.abs(here[order + 1]).max()
            # the highest order may jump where a piece begins
            allowed = 4 if order == self.orders - 2 else 0
            assert np.count_nonzero(wrong) <= allowed, f"order {order + 1} is not the derivative of {order}"

    def test_pull_is_the_gradient(self) -> None:
        family, p = self.draw(3)
        t = self.times(family.trajectory(p), 9)
        G = np.random.default_rng(4).standard_normal(family.motion(p, t, self.orders).orders.shape)
        expected = central(lambda x: float(np.sum(G * family.motion(x, t, self.orders).orders)), p)
        close(family.vjp(p, t, G), expected, 1e-7, "pull")

    def test_rows_agree_with_bound(self) -> None:
        family, p = self.draw(5)
        trajectory = family.trajectory(p)
        for order in range(self.orders):
            for degree in (1, 2):
                rows, offset, kappa = family.rows(order, degree)
                values, _, proved = trajectory.bound(order, degree)
                row_values = np.einsum("kmp,p->mk", rows, p) + offset.T
                if row_values.shape == values.shape:
                    close(row_values, values, 1e-10, f"rows of order {order}")
                    assert abs(kappa - proved) < 1e-15, "rows and bound give different constants"
                else:  # instants of their own: what they admit, the proof must
                    admitted, needed = (
                        np.abs(part).max(axis=0) ** degree / k
                        for part, k in ((row_values, kappa), (values, proved))
                    )
                    assert np.all(needed <= admitted * (1.0 + 1e-12)), f"rows of order {order} admit too much"

    def test_the_bound_holds_at_all_times(self) -> None:
        trajectory = self._trajectory(6)
        for order in range(self.orders):
            values, amplitudes, kappa = trajectory.bound(order, 1)
            limit = np.abs(values).max(axis=0) / kappa + 1e-9 * amplitudes
            for t in np.array_split(self.times(trajectory, self.instants), max(1, self.instants // 20_000)):
                reached = np.abs(trajectory.motion(t, self.orders).orders[order]).max(axis=0)
                assert np.all(reached <= limit), f"order {order} reaches {reached}, the bound says {limit}"

    def test_text_gives_it_back_to_the_bit(self) -> None:
        trajectory = self._trajectory(7)
        again = from_json(trajectory.to_json())
        t = self.times(trajectory, 99)
        same(again.motion(t, self.orders).orders, trajectory.motion(t, self.orders).orders, "read back")
        assert again.form == trajectory.form

    def test_slowed_is_the_same_path(self) -> None:
        trajectory = self._trajectory(8)
        slow = trajectory.slowed(2.0)
        t = self.times(trajectory, 40)
        assert abs(slow.duration - 2.0 * trajectory.duration) <= 1e-9 * trajectory.duration
        fast, half = trajectory.motion(t, 2).orders, slow.motion(2.0 * t, 2).orders
        close(half[0], fast[0], 1e-9, "path of the slowed trajectory")
        close(half[1], 0.5 * fast[1], 1e-9, "velocity of the slowed trajectory")

    def _trajectory(self, seed: int) -> Trajectory:
        family, p = self.draw(seed)
        return family.trajectory(p)


PAIRS = 2_000
"""Pairs of poses, at each of three distances, at which slopes are held against the function."""
PERIODS = 20_001
"""Instants at which a proof is held against what the limit measures."""
LARGEST = 4.0
"""Size of a motion, as a factor on a drawn one, up to which the edge of a limit without cones is searched."""
SLACK = 0.03
"""A proof may exceed what is reached by this part of the limit's width, and no more."""


class LimitSuite:
    """Laws of `protocols.Limit`. Set `limit`, `family`, and `home`, a pose (k,) well inside."""

    limit: ClassVar[Limit]
    family: ClassVar[Family]
    home: ClassVar[Array]
    tight: ClassVar[bool] = True
    """False for a limit whose cones are narrower than itself (a tilt asked of both signs)."""

    def test_every_ability_is_whole(self) -> None:
        required(self.limit, Limit, type(self.limit).__name__)

    def test_what_the_cones_admit_is_proved(self) -> None:
        for seed in range(6):
            family, p = self._edge(seed, 1.0)
            if not self.limit.cones(family):
                return  # nothing is admitted by cones
            rows = self.limit.prove(family.trajectory(p))
            margins = [_slack(row) for row in rows if row.status == "proved"]
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
            assert min(_slack(row) for row in rows) < 0.0, "3 % beyond the limit, and still proved"

    def test_the_proof_holds_what_is_measured(self) -> None:
        verified = False
        for seed in range(3):
            family, p = self._edge(seed, 0.9)
            trajectory = family.trajectory(p)
            rows = self.limit.prove(trajectory)
            t = np.linspace(0.0, trajectory.duration, PERIODS)
            measured = self.limit.of_motion(trajectory.motion(t, 4))
            assert measured.shape == (PERIODS, len(rows)), "of_motion has one column for each row of prove"
            for row, values in zip(rows, measured.T, strict=True):
                self._require_bounds(row, values)
                verified |= row.status != "not verified"
        assert verified, "no row is verified, so no law was tried: set a limit with a model"

    def _require_bounds(self, row: Proof, values: Array) -> None:
        width = row.upper - row.lower
        size = width if np.isfinite(width) else max(abs(row.proved_lower), abs(row.proved_upper))
        name = f"{row.quantity} of {row.axis}"
        if row.status == "not verified":
            return
        assert values.max() <= row.proved_upper + 1e-9 * size, f"{name} reaches more than is proved"
        assert values.min() >= row.proved_lower - 1e-9 * size, f"{name} reaches less than is proved"
        if self.tight:
            assert row.proved_upper <= values.max() + SLACK * size, f"the proof of {name} is loose"
            least = -values.max() if row.proved_lower == -row.proved_upper else values.min()  # of a size
            assert row.proved_lower >= least - SLACK * size, f"the proof of {name} is loose"

    def test_slopes_bound_the_function(self) -> None:
        """|h(q') - h(q)| <= sum_j slopes_j |q'_j - q_j| at random pairs of poses, near and far."""
        if not isinstance(self.limit, LipschitzLimit):
            return
        rng, slopes = np.random.default_rng(0), np.asarray(self.limit.slopes, dtype=float)
        family, centre, direction = self._drawn(0)
        trajectory = family.trajectory(centre + direction)
        path = trajectory.motion(np.linspace(0.0, trajectory.duration, PAIRS), 1).orders[0]
        assert slopes.shape == path.shape[1:], f"{len(slopes)} slopes, {path.shape[1]} coordinates"
        lower, upper = path.min(axis=0), path.max(axis=0)
        for part in (1e-3, 0.1, 1.0):
            poses = rng.uniform(lower, upper, path.shape)
            turned = rng.uniform(-1.0, 1.0, path.shape) * (rng.uniform(size=path.shape) < 0.5)
            moved = np.clip(poses + part * (upper - lower) * turned, lower, upper)
            first, second = (self.limit.function(x) for x in (poses, moved))
            bound = np.abs(moved - poses) @ slopes
            excess = np.abs(second - first) - bound - 1e-9 * (1.0 + np.abs(first).max())
            worst = int(np.argmax(excess))
            assert excess[worst] <= 0.0, (
                f"from {poses[worst]} to {moved[worst]} the value changes by more than {bound[worst]:.3g}: "
                "a slope is too small"
            )

    def test_the_penalty_has_its_gradient(self) -> None:
        family, p = self._edge(0, 1.05)
        t = family.trajectory(p).duration * np.linspace(0.05, 0.95, 5)
        motion = family.motion(p, t, 3)
        penalty = self.limit.penalty(motion)
        if penalty is None:
            return
        value, gradient = penalty

        def of_orders(orders: Array) -> float:
            again = self.limit.penalty(type(motion)(t, orders))
            assert again is not None
            return again[0]

        assert value >= 0.0
        close(gradient, central(of_orders, motion.orders, 1e-5), 1e-5, "gradient of the penalty")

    def test_home_is_inside(self) -> None:
        family = self.family.drawn(np.random.default_rng(0))
        rows = self.limit.prove(family.trajectory(_resting(family, self.home)))
        assert all(_slack(row) >= 0.0 for row in rows if row.status == "proved"), "home is outside the limit"

    def _edge(self, seed: int, part: float) -> tuple[Family, Array]:
        """A drawn family and parameters in a random direction from home, `part` of the way to the edge."""
        family, centre, direction = self._drawn(seed)
        reaches = [_reach(_in_cone(cone, centre, direction), 1e9) for cone in self.limit.cones(family)]
        measured = self._measured_inside(family, centre, direction)
        reach = min(reaches) if reaches else _reach(measured, LARGEST)
        return family, centre + part * reach * direction

    def _drawn(self, seed: int) -> tuple[Family, Array, Array]:
        """A drawn family, its parameters of standing at home, and a random direction of deviation 1."""
        rng = np.random.default_rng(seed)
        family = self.family.drawn(rng)
        return family, _resting(family, self.home), rng.standard_normal(family.size)

    def _measured_inside(self, family: Family, centre: Array, direction: Array) -> Callable[[float], bool]:
        """Whether the motion at `s` along the direction is measured inside; of use where no cone says it."""
        trajectory = family.trajectory(centre)
        rows, t = self.limit.prove(trajectory), np.linspace(0.0, trajectory.duration, PAIRS)
        lower, upper = (np.array([getattr(row, side) for row in rows]) for side in ("lower", "upper"))

        def inside(s: float) -> bool:
            values = self.limit.of_motion(family.motion(centre + s * direction, t, 4))
            return bool(np.all((values >= lower) & (values <= upper)))

        return inside


def _resting(family: Family, home: Array) -> Array:
    """Parameters (P,) nearest to standing still at `home`, by least squares on the path."""
    t = np.linspace(0.0, family.trajectory(np.zeros(family.size)).duration, 4 * family.size + 1)
    zero = family.motion(np.zeros(family.size), t, 1).orders[0]
    columns = [family.motion(e, t, 1).orders[0] - zero for e in np.eye(family.size)]
    A = np.stack([column.ravel() for column in columns], axis=1)
    solution, *_ = np.linalg.lstsq(A, (home - zero).ravel(), rcond=None)
    return np.asarray(solution)


def _in_cone(cone: Cone, centre: Array, direction: Array) -> Callable[[float], bool]:
    """Whether centre + s direction is inside the cone, as a function of s."""
    u, w = cone.rows @ centre + cone.offset, cone.rows @ direction
    reach, slope = (1.0, 0.0) if cone.slope is None else (1.0 + cone.slope @ centre, cone.slope @ direction)
    return lambda s: bool(np.all(np.sqrt(((u + s * w) ** 2).sum(axis=0)) <= reach + s * slope))


def _reach(inside: Callable[[float], bool], largest: float) -> float:
    """Largest s that is inside, by bisection; about `largest` if none is outside."""
    low, high = 0.0, 1.0
    while inside(high) and high < largest:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if inside(middle) else (low, middle)
    return low


def _slack(row: Proof) -> float:
    """Distance of the proved interval from the limit; negative: the limit is violated."""
    return min(row.upper - row.proved_upper, row.proved_lower - row.lower)


def worst(rows: Sequence[Proof]) -> float:
    """Least room over all rows."""
    return min(_slack(row) for row in rows)
