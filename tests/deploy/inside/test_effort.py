"""The learned command along a trajectory, by a model that is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude.campaign import create_campaign, typical_motions
from etude.deploy.feedforward import effort
from etude.protocols import Inputs
from etude.types import Array, Log

GRAVITY = np.array([5.0, 4.0, 3.0, 2.0])


class Pendulums:
    """Four joints that know their own weight and inertia."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs

    def static(self, log: Log) -> Array:
        return GRAVITY * np.sin(log["q"])

    def predict(self, log: Log) -> tuple[Array, Array]:
        return self.static(log) + 2.0 * log["qdd"], np.full(log["q"].shape, 0.25)


def test_gravity_is_apart_from_what_motion_takes(tmp_path: Path) -> None:
    campaign, _ = create_campaign(tmp_path / "lab", "arm4", seed=1)
    trajectory = typical_motions(campaign, np.random.default_rng(0), 1)[0]
    model: Any = Pendulums(campaign.kind.inputs(campaign.spec, campaign.config))
    found = effort(trajectory, model, 20.0)
    assert (len(found.t), found.t[-1]) == (1201, trajectory.duration)
    q, _, qdd = trajectory.motion(found.t, 3).orders
    np.testing.assert_array_equal(found.static, GRAVITY * np.sin(q))
    np.testing.assert_allclose(found.moving, 2.0 * qdd, atol=1e-12)
    np.testing.assert_array_equal(found.deviation, 0.5)
    assert found.largest == pytest.approx(np.abs(found.command).max(axis=0))
