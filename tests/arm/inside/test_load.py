"""A load at the last link, by the errors of a model that does not know it: what it weighs and where it is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from loading_examples import write
from test_identified_files import motion, spec_of

from etude.models import NORMAL_95, Load, about_origin, apparent_loads, load_of
from etude.types import Log, Samples
from etude_arm import ArmPhysics, ArmSpec

KG, CENTRE = 0.5, np.array([0.02, -0.03, 0.08])
NOISE = 0.1


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> ArmSpec:
    return spec_of(write(tmp_path_factory.mktemp("robot")))


def found(
    spec: ArmSpec,
    kg: float,
    seed: int = 0,
    size: float = 3.0,
    error: Any = None,
    apparent: np.ndarray | None = None,
    learned: Any = None,
) -> Load:
    """Of 40 s along a motion; error: (n, J) of states that the model makes beside noise that remembers."""
    return load_of(*parts(spec, kg, seed, size, error, learned), apparent)


def parts(
    spec: ArmSpec, kg: float, seed: int, size: float = 3.0, error: Any = None, learned: Any = None
) -> tuple[Any, ...]:
    """A model that knows nothing but what was `learned` (n, J) of states, samples, and the body."""
    rng = np.random.default_rng(seed)
    states = [size * part for part in motion(rng, 800, spec.dof)]
    channels = {c.name: c for c in spec.channels()}
    names = ("q", "qd", "qdd", "command")
    ten = np.concatenate([[kg], kg * CENTRE, about_origin(kg, kg * CENTRE)])
    body = ArmPhysics(spec, nominal=True)(None)
    values = dict(zip(names, [*states, np.zeros_like(states[0])], strict=True))
    log = Log(0.05 * np.arange(800), {name: channels[name] for name in names}, values)
    noise = rng.normal(size=states[0].shape)
    for k in range(1, len(noise)):
        noise[k] = 0.8 * noise[k - 1] + 0.6 * noise[k]
    command = body.links(log)[:, :, -1] @ ten + NOISE * noise
    command += 0.0 if error is None else error(*states)

    def mean(of: Log) -> np.ndarray:
        return np.zeros_like(command) if learned is None else learned(body.predict(of), of["qd"])

    log = log.put(channels["command"], command + mean(log))
    samples = Samples(
        log, np.zeros(800, np.int64), np.ones(command.shape, bool), np.ones(command.shape, bool)
    )
    known = np.full(command.shape, NOISE**2)
    model = SimpleNamespace(
        parted=lambda of: (mean(of), known, known), mean=mean, worth=lambda: np.full(spec.dof, 0.1)
    )
    return model, samples, body


def test_mass_and_centre_are_those_of_the_load(spec: ArmSpec) -> None:
    z = []
    for seed in range(8):
        load = found(spec, KG, seed)
        assert load.verdict == "load"
        assert load.mass == pytest.approx(KG, rel=0.1)
        z.append([(load.mass - KG) / load.deviation, *((load.centre - CENTRE) / load.centre_deviation)])
    assert np.mean(np.abs(z) < NORMAL_95) >= 0.85
    assert np.std(z) > 0.4, "intervals are not far too wide"


def test_an_empty_hand_weighs_nothing(spec: ArmSpec) -> None:
    for seed in range(8):
        load = found(spec, 0.0, seed)
        assert load.verdict == "none"
        assert abs(load.mass) < 2.5 * load.deviation


def test_what_was_put_down_is_less_than_nothing(spec: ArmSpec) -> None:
    load = found(spec, -KG)
    assert load.verdict == "load"
    assert load.interval[0] < -KG < load.interval[1]
    np.testing.assert_allclose(load.centre, CENTRE, atol=2.5 * load.centre_deviation.max())


def test_more_friction_is_no_load(spec: ArmSpec) -> None:
    load = found(spec, 0.0, error=lambda q, qd, qdd: 0.8 * np.tanh(qd / 0.04))
    assert load.verdict != "load"
    assert load.left > 4.0


def rubbing(weight: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Commands (n, J) of a learned arm: its weight, which dwarfs the load's, and its friction."""
    return 3.0 * weight + 2.0 * np.tanh(qd / 0.04) + 0.5 * qd


@pytest.mark.parametrize("kg", [0.0, KG])
@pytest.mark.parametrize(
    ("friction", "gain"), [(0.6, 1.0), (1.4, 1.0), (1.0, 0.97), (1.0, 1.03), (0.8, 1.02)]
)
def test_a_warm_drive_is_no_load(spec: ArmSpec, kg: float, friction: float, gain: float) -> None:
    """Friction and torque constants drift within their priors; the load stays inside its interval."""
    _, samples, body = parts(spec, kg, 4)
    weight = body.predict(samples.log)

    def drifted(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        load = parts(spec, kg, 4)[1].command
        there = 3.0 * weight + friction * (rubbing(weight, qd) - 3.0 * weight)
        return gain * (there + load) - load - rubbing(weight, qd)

    load = found(spec, kg, 4, error=drifted, learned=rubbing)
    assert load.verdict == ("load" if kg else "none")
    assert abs(load.mass - kg) < 2.5 * load.deviation
    assert load.deviation < 0.12 * KG, "a drift costs little"


def test_friction_that_was_not_learned_is_left_beside_the_load(spec: ArmSpec) -> None:
    quiet = found(spec, 0.0, 4, learned=rubbing)
    assert quiet.left < 2.0
    other = found(spec, 0.0, 4, learned=rubbing, error=lambda q, qd, qdd: 4.0 * np.sin(5.0 * q))
    assert other.left > 4.0
    assert other.verdict != "load"


def test_a_motion_that_hardly_moves_cannot_tell_where_the_centre_is(spec: ArmSpec) -> None:
    load = found(spec, KG, size=0.02)
    assert load.verdict == "cannot tell" or np.all(NORMAL_95 * load.centre_deviation.max() > 0.05)


def test_a_mass_that_no_command_holds_cannot_be_told(spec: ArmSpec) -> None:
    """The origin of the last link lies on every axis, as in an arm of two crossing axes."""
    model, samples, body = parts(spec, 0.0, 3)
    places = np.where(np.arange(10) == 0, 0.0, 1.0)
    crossing = SimpleNamespace(links=lambda log: body.links(log) * places)
    assert load_of(model, samples, crossing).verdict == "cannot tell"


def test_loads_that_logs_without_one_seem_to_carry_widen_the_interval(spec: ArmSpec) -> None:
    model, samples, body = parts(spec, KG, 1)
    samples = replace(samples, group=np.repeat([0, 1], 400))
    # physics without the first log are right, and without the second know of no load
    truth = body.links(samples.log)[:, :, -1] @ np.concatenate(
        [[KG], KG * CENTRE, about_origin(KG, KG * CENTRE)]
    )
    seen = apparent_loads({0: truth, 1: 0.0 * truth}, model, samples, body)
    assert seen.shape == (2, 10)
    assert abs(seen[0, 0]) < 0.2 * KG
    assert seen[1, 0] == pytest.approx(KG, rel=0.2)
    alone, wider = found(spec, KG, 1), found(spec, KG, 1, apparent=seen)
    assert wider.mass == alone.mass
    assert wider.deviation == pytest.approx(np.hypot(alone.deviation, np.sqrt(np.mean(seen[:, 0] ** 2))))
    assert wider.verdict != "load"
    assert apparent_loads({}, model, samples, body).shape == (0, 10)


def test_the_inertia_of_a_point_is_that_of_mechanics() -> None:
    xx, yy, zz, xy, xz, yz = about_origin(2.0, 2.0 * np.array([0.1, 0.2, 0.3]))
    assert (xx, yy, zz) == pytest.approx((2.0 * 0.13, 2.0 * 0.10, 2.0 * 0.05))
    assert (xy, xz, yz) == pytest.approx((-2.0 * 0.02, -2.0 * 0.03, -2.0 * 0.06))
