"""Commands in another unit than the model file's are named with both units."""

from __future__ import annotations

import numpy as np
import pytest

from etude.logs import Seen
from etude.logs.checks.command_units import scale_finding


@pytest.mark.parametrize(
    ("units", "said"),
    [
        (("rad", "rad"), "times the torque of the model file: they look like thousandths of N m."),
        (("m", "m"), "times the force of the model file: they look like thousandths of N."),
        (("m", "rad"), "times the torque or force of the model file: they look like thousandths of N m (N)."),
    ],
)
def test_so_it_is_where_a_log_has_another_unit(units: tuple[str, str], said: str) -> None:
    force = np.random.default_rng(0).standard_normal((200, 2))
    still, moving = np.zeros((200, 2)), np.ones((200, 2), dtype=np.bool_)
    far = np.linspace(0.0, 1.0, 200)[:, None] * np.ones(2)
    times, milli = np.arange(200) / 100, 1e3 * force
    motion = Seen(times, 0.01, far, still, still, None, milli, moving, ("a", "b"), units, 10.0)
    finding = scale_finding(motion, force, np.full(2, 10.0))
    assert finding is not None
    assert said in finding.sentence
