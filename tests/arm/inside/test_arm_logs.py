"""Samples of the logs that come with the package, held to their values when they were first measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etude.logs import read_log
from etude_arm import KIND
from etude_arm.preprocessing import ArmData, samples_of

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.mark.parametrize(
    ("name", "count", "bend", "command", "moving"),
    [
        ("ur10", 227, 956.623685749278, 1447944.1774149975, 1216),
        ("tx40", 155, 328828.6623362213, 359552.7778377824, 673),
        ("tiago", 663, 28.42253545071253, 3113.7103272248028, 2218),
    ],
)
def test_recorded_logs_give_the_samples_they_always_gave(
    name: str, count: int, bend: float, command: float, moving: int
) -> None:
    spec = KIND.spec(EXAMPLES / name / f"{name}.toml")
    expected = KIND.expected(spec)
    path = EXAMPLES / name / f"{name}_exciting.csv"
    log = read_log(path, KIND.channels(spec), rate=expected.rate, limits=expected.limits)
    samples = samples_of(spec, ArmData(least_samples=150), [log], [np.zeros(len(log), dtype=np.int64)])
    assert len(samples) == count
    assert samples.moving.sum() == moving
    assert np.sum(samples.log["qdd"] ** 2) == pytest.approx(bend, rel=1e-9)
    assert np.sum(samples.command**2) == pytest.approx(command, rel=1e-9)
