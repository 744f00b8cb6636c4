"""A room that does not hold the origin: flights are about its middle, in x and y as in z."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from etude.limits import FeasibleSet, certify, uniform
from etude_quadrotor import KIND, FlightConfig

ROBOT = Path(__file__).parents[2] / "examples" / "px4" / "px4_quad.toml"


@pytest.mark.parametrize(
    ("lower", "upper"), [((2.0, 3.0), (14.0, 15.0)), ((-30.0, -4.0), (-18.0, 8.0)), ((0.5, -6.0), (9.0, 6.0))]
)
def test_motions_are_about_its_middle(lower: tuple[float, float], upper: tuple[float, float]) -> None:
    spec = replace(KIND.spec(ROBOT), lower=(*lower, 0.0), upper=(*upper, 5.0))
    config = SimpleNamespace(trajectory=FlightConfig(2, 15.0))
    allowed, family = KIND.limits(spec, config, None, {}), KIND.family(spec, config)
    room = FeasibleSet.of(allowed, family, KIND.home(spec))
    motion = family.trajectory(uniform(np.random.default_rng(1), room)[0])
    assert certify(motion, allowed).ok
    place = motion.motion(np.linspace(0.0, motion.duration, 400), 1).orders[0]
    assert (place[:, :2] > lower).all()
    assert (place[:, :2] < upper).all()
    assert len(KIND.tests(spec, config, np.random.default_rng(0))) == 2
