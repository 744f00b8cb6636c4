"""What is named of a changed robot: load, friction, a sensor's offset, or nothing."""

from __future__ import annotations

import numpy as np
import pytest

from etude.models.change.diagnosis import alone, cause


class TestCause:
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 0.125)[:, None]
    rates = np.array([[0.7, 1.1, 1.7]])
    q = np.sin(t * rates) + 0.6 * np.cos(2.3 * t * rates)
    v = np.gradient(q, 0.125, axis=0)
    a = np.gradient(v, 0.125, axis=0)
    motion = (np.sin(q), v, a)
    noise = rng.standard_normal(q.shape)
    use = np.abs(v) > 0.05
    deviation = np.ones_like(q)
    one = np.array([0.0, 1.0, 0.0])

    def named(self, error: np.ndarray, motion: tuple[np.ndarray, ...] | None = None) -> str:
        return cause(error + self.noise, self.deviation, self.use, motion or self.motion)

    @pytest.mark.parametrize(
        ("error", "name"),
        [
            (5.0 * np.sin(q) + 2.0 * a, "load"),
            (5.0 * np.sin(q) * one, "load"),
            (5.0 * np.sign(v), "friction"),
            (5.0 * np.sign(v) * one, "friction"),
            (4.0 * np.ones_like(q) * one, "offset"),
            (0.0 * q, "unknown"),
            (5.0 * rng.standard_normal(q.shape), "unknown"),
            (4.0 * np.sign(v) + 6.0 * np.sin(q), "unknown"),
        ],
    )
    def test_it_is_named_only_where_it_is_clear(self, error: np.ndarray, name: str) -> None:
        assert self.named(error) == name

    @pytest.mark.parametrize(
        ("size", "name"),
        [([3.0, 4.0, 2.0], "load"), ([-3.0, -4.0, -2.0], "load"), ([3.0, -4.0, 2.0], "offset")],
    )
    def test_in_poses_much_alike_a_load_acts_on_several_outputs_with_gravity(
        self, size: list[float], name: str
    ) -> None:
        alike = 20.0 + 0.3 * np.sin(self.q)
        error = np.array(size) * np.ones_like(self.q)
        assert self.named(error, (alike, self.v, self.a)) == name
        assert self.named(error * self.one, (alike, self.v, self.a)) == "offset"

    def test_deviations_weigh_the_outputs(self) -> None:
        deviation = self.deviation * np.array([1.0, 1.0, 100.0])
        error = 5.0 * np.sin(self.q) * (1.0 - self.one) + 150.0 * np.sign(self.v) * np.array([0, 0, 1])
        assert cause(error + self.noise, deviation, self.use, self.motion) == "load"
        assert cause(error + self.noise, self.deviation, self.use, self.motion) == "friction"

    def test_without_samples_nothing_is_named(self) -> None:
        nothing = np.zeros_like(self.use)
        assert cause(self.noise, self.deviation, nothing, self.motion) == "unknown"
        assert alone(self.noise, self.deviation, nothing) is None

    def test_one_output_alone(self) -> None:
        assert alone(self.noise + 5.0 * self.one, self.deviation, self.use) == 1
        assert alone(self.noise + 5.0, self.deviation, self.use) is None
