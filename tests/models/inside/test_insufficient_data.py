"""Short motion is learned without harm: the model says that it is uncertain, and nobody trusts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learning_examples import LIMIT, SMALL, train, trajectories, trajectory

from etude.codes import Warn
from etude.models import prediction_score
from etude.models.selection.selection_rule import DOUBT
from etude.models.trust import trust
from etude.types import Samples

AUTO = replace(SMALL, rung="auto")


def cut(samples: Samples, seconds: float) -> Samples:
    return samples.take(samples.t < samples.t.min() + seconds)


@pytest.mark.parametrize("config", [SMALL, AUTO], ids=["gp", "auto"])
def test_a_short_log_is_not_believed(config) -> None:
    model = train(cut(trajectory(1), 5.0), config)
    new = trajectory(9)
    mean, variance = model.predict(new.log)
    assert np.all(np.sqrt(variance) >= 0.99 * DOUBT * LIMIT)
    assert np.all(prediction_score(new, mean, variance).coverage > 0.95)
    assert np.all(trust(variance, model.prior_deviation) == 0.0)
    assert any(one.code == Warn.TOO_LITTLE_MOTION for one in model.warnings)


def test_a_command_whose_joint_hardly_moved_is_doubted_alone() -> None:
    data = trajectories(2)
    moving = data.moving.copy()
    moving[data.t > data.t.min() + 1.0, 1] = False
    model = train(replace(data, moving=moving), SMALL)
    deviation = np.sqrt(model.predict(data.log)[1].min(axis=0))
    assert deviation[1] >= 0.99 * DOUBT * LIMIT[1]
    assert deviation[0] < 0.5 * DOUBT * LIMIT[0]
    (one,) = [one for one in model.warnings if one.code == Warn.TOO_LITTLE_MOTION]
    assert one.fields["commands"] == ("b",)


def test_enough_motion_is_believed() -> None:
    model = train(trajectories(2), SMALL)
    assert not any(one.code == Warn.TOO_LITTLE_MOTION for one in model.warnings)
    assert np.sqrt(model.predict(trajectory(1).log)[1]).min() < DOUBT * LIMIT.min()
