"""What every family of trajectories owes, and every trajectory in it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etude.protocols import Family, Trajectory
from etude.testing.differences import central, close, same
from etude.trajectories.json_text import from_json
from etude.types import Array


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
        close(family.pull(p, t, G), expected, 1e-7, "pull")

    def test_rows_agree_with_bound(self) -> None:
        family, p = self.draw(5)
        trajectory = family.trajectory(p)
        for order in range(self.orders):
            for degree in (1, 2):
                rows, offset, kappa = family.rows(order, degree)
                values, _, proved = trajectory.bound(order, degree)
                found = np.einsum("kmp,p->mk", rows, p) + offset.T
                if found.shape == values.shape:
                    close(found, values, 1e-10, f"rows of order {order}")
                    assert abs(kappa - proved) < 1e-15, "rows and bound give different constants"
                else:  # instants of their own: what they admit, the proof must
                    admitted, needed = (
                        np.abs(part).max(axis=0) ** degree / k
                        for part, k in ((found, kappa), (values, proved))
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
