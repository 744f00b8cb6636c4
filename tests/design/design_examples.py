"""A small arm and a vehicle, models that have learned some of their motions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np

from etude.models import ExactGP, SquaredExponential, structured
from etude.protocols import Candidate, Inputs, Limit, Posterior
from etude.trajectories import FourierConfig, FourierFamily, PointToPoint
from etude_arm import KIND, ArmInputs, ArmSpec, Axis
from etude_quadrotor import KIND as VEHICLE
from etude_quadrotor import FlightConfig, QuadrotorInputs, QuadrotorSpec

V0 = np.array([0.05, 0.05])
ARM_FAMILIES = {
    "nullspace": FourierConfig(harmonics=4, duration=30.0),
    "ramp, omega0 drawn": FourierConfig(harmonics=2, duration=30.0, omega0=(0.2, 0.5), rest="ramp"),
}
DRAG = (0.6, 0.5, 0.1)


@dataclass(frozen=True, eq=False)
class Process:
    """As a design sees one: latent functions with their commands."""

    found: tuple[tuple[Posterior, tuple[int, ...]], ...]

    def latents(self) -> tuple[tuple[Posterior, tuple[int, ...]], ...]:
        return self.found


@dataclass(frozen=True, eq=False)
class Model:
    """As a design sees one."""

    inputs: Inputs
    candidates: tuple[Candidate, ...]


def candidate(
    posterior: Posterior | None, commands: Sequence[int], *, structure="gp", weight=1.0, factor=1.0
) -> Candidate:
    """One process for all these commands."""
    m = len(commands)
    process = None if posterior is None else Process(((posterior, tuple(range(m))),))
    units = np.stack([np.zeros(m), np.broadcast_to(np.asarray(factor, dtype=float), m)])
    return Candidate(structure, tuple(commands), np.full(m, weight), None, process, units, np.ones(m))


def arm_spec() -> ArmSpec:
    axes = (Axis("base", -0.9, 0.7, 0.5, 1.0, 50.0), Axis("tip", 0.2, 1.6, 0.8, 2.0, 20.0))
    return ArmSpec("pair", axes, "N m", 100.0)


def arm_home() -> np.ndarray:
    return 0.5 * (arm_spec().lower + arm_spec().upper)


def arm_limits(spec: ArmSpec | None = None) -> tuple[Limit, ...]:
    return tuple(KIND.limits(spec or arm_spec(), None, None, {}))


def arm_inputs(stick: float = 0.02) -> ArmInputs:
    channels = {c.name: c for c in arm_spec().channels()}
    return ArmInputs(channels, np.full(2, stick), V0, (1.0,))


def arm_family(name: str = "nullspace") -> FourierFamily:
    return FourierFamily.of(ARM_FAMILIES[name], 2)


def arm_point(rng: np.random.Generator, family: FourierFamily, size: float = 1.0) -> np.ndarray:
    """Parameters (P,) of a motion about the middle, some tenths of the ranges wide."""
    table = np.zeros_like(family.offset)
    table[0] = arm_home()
    return family.parameters(table) + size * 0.1 * rng.standard_normal(family.size)


def moves() -> PointToPoint:
    """A task of three moves."""
    points = np.array([[-0.5, 0.4], [0.3, 1.2], [0.0, 0.6], [-0.6, 1.4]])
    return PointToPoint(points, 0.4, 0.3, 1.0)


@cache
def arm_model(seed: int = 0, points: int = 60, stick: float = 0.02, unit: float = 1.0) -> Model:
    """Two outputs of very different size, in parts of `unit`, each with its kernel, from two motions."""
    rng, inputs, family = np.random.default_rng(seed), arm_inputs(stick), arm_family()
    t = np.linspace(1.0, 29.0, points // 2)
    X = np.concatenate(
        [inputs.plan(family.motion(arm_point(rng, family), t, inputs.orders)).X for _ in range(2)]
    )
    found = []
    for j, size in enumerate((30.0 / unit, 2.0 / unit)):
        y = size * (np.sin(X[:, j]) + 0.5 * X[:, 6 + j] + 0.2 * X[:, 4 + j])
        kernel = structured(inputs.columns, (arm_spec().names[j],))
        theta = kernel.initial(0.5 * np.ptp(X, axis=0), size)
        posterior = ExactGP(kernel, theta, np.log(0.03 * size)).condition(X, y - y.mean())
        found.append(candidate(posterior, (j,), factor=unit))
    return Model(inputs, tuple(found))


def flight_family(*, rest: bool = False) -> FourierFamily:
    if rest:
        config = FourierConfig(harmonics=4, duration=30.0, omega0=4.0 * math.pi / 30.0)
        return FourierFamily.of(config, 3)
    return FourierFamily.of(FourierConfig(2, 30.0, rest="none"), 3, (0.0, 0.0, None))


def flight_spec(**changes) -> QuadrotorSpec:
    given = {
        "name": "example",
        "lower": (-10.0, -10.0, 0.3),
        "upper": (10.0, 10.0, 5.0),
        "speed": 5.0,
        "command_names": ("m1", "m2", "m3", "m4"),
        "command_unit": "V",
        "command_lower": (0.0,) * 4,
        "command_upper": (11.1,) * 4,
        "rate": 10.0,
    }
    return QuadrotorSpec(**(given | changes))


def flight_limits(spec: QuadrotorSpec) -> tuple[Limit, ...]:
    return tuple(VEHICLE.limits(spec, SimpleNamespace(trajectory=FlightConfig()), None, {}))


def flight_home(spec: QuadrotorSpec) -> np.ndarray:
    return VEHICLE.home(spec)


def flight_point(rng: np.random.Generator, family: FourierFamily) -> np.ndarray:
    """Parameters (P,) of a gentle flight about (0, 0, 2.5) m."""
    table = np.zeros_like(family.offset)
    table[0] = (0.0, 0.0, 2.5)
    return family.parameters(table) + 0.5 * rng.standard_normal(family.size)


def flight_inputs(**changes) -> QuadrotorInputs:
    return replace(QuadrotorInputs(drag=DRAG), **changes)


@cache
def flight_model(
    inputs: QuadrotorInputs | None = None, points: int = 40, *, shared: bool = False, length: float = 2.0
) -> Model:
    """Processes of different amplitude and lengths, or one for all, from two random flights."""
    inputs, family, rng = inputs or flight_inputs(), flight_family(), np.random.default_rng(11)
    t = np.linspace(0.5, 29.5, points // 2)
    X = np.concatenate(
        [inputs.plan(family.motion(flight_point(rng, family), t, inputs.orders)).X for _ in range(2)]
    )
    kernel = SquaredExponential(tuple(range(X.shape[1])))
    made = []
    for j in range(1 if shared else 4):
        theta = kernel.initial((length + j) * np.maximum(np.ptp(X, axis=0), 0.1), 1.0 + j)
        y = np.sin(X[:, j]) - np.sin(X[:, j]).mean()
        posterior = ExactGP(kernel, theta, np.log(0.2)).condition(X, y)
        factor = [0.5, 1.0, 2.0, 4.0] if shared else 0.5 * 2.0**j
        made.append(candidate(posterior, range(4) if shared else (j,), factor=factor))
    return Model(inputs, tuple(made))


def assert_same(exact: np.ndarray, approximate: np.ndarray, tolerance: float = 1e-6) -> None:
    """Equal to `tolerance` of the largest entry."""
    np.testing.assert_allclose(exact, approximate, rtol=0.0, atol=tolerance * np.abs(exact).max())
