"""Certified motions, sampled a hundred times as densely as their proofs: no row that says proved is left.

ETUDE_MOTIONS=100:300 takes the batches of other seeds, or more; ETUDE_BATCH=400 larger ones; -s prints a line
for each robot and form. A batch of one robot and form is drawn on the edge of what is allowed, by three
samplers. Designed motions, with all limits that a robot has, are a test of their own.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from robots_of_others import FILES, robot_of

from etude.campaign import find_robot, preset_config
from etude.design import DesignConfig, design, linked_chain, prior_latents
from etude.limits import FeasibleSet, boundary, certify, scaled, uniform
from etude.protocols import Family, Limit, Trajectory
from etude.trajectories import OVERSAMPLING, FourierConfig, FourierTrajectory
from etude.types import Array, Motion
from etude_arm import KIND, ArmSpec
from etude_arm.motions import approaches as arm_ways
from etude_arm.motions import family as arm_family
from etude_arm.motions import limits as arm_limits
from etude_arm.space.table import Cartesian
from etude_quadrotor import FlightConfig, QuadrotorSpec, flight_family

HARMONICS, DURATION, DENSER = 5, 20.0, 100
CHUNK = 1000
"""Instants at a time."""
ROUNDING = 1e-9
"""Part of a limit's width: samples are rounded too."""
VEHICLES = ("quadrotor", "pelican")
ARMS = ("arm4", "mobile_arm", *(name for name in FILES if name != "talos"))
FORMS = ("rest", "ramp", "free", "chain", "ways")
SAMPLERS = (scaled, boundary, uniform)
EVERY_DAY = [("arm4", "rest"), ("arm4", "chain"), ("quadrotor", "free"), ("quadrotor", "ways")]


@dataclass(frozen=True)
class World:
    """What a motion is drawn from and held against."""

    family: Family
    limits: tuple[Limit, ...]
    home: Array
    way: Callable[[Trajectory, Array], tuple[Trajectory, Trajectory]]


def world(name: str, form: str) -> World:
    """Of limits that are proved by cones; others have tests of their own."""
    rest = "nullspace" if form in ("chain", "ways") else {"rest": "nullspace", "free": "none"}.get(form, form)
    if name in VEHICLES:
        kind, path = find_robot(name)
        spec: QuadrotorSpec = kind.spec(path)
        config = FlightConfig(HARMONICS, DURATION, rest=rest == "nullspace", free_centre=True)
        own = tuple(kind.limits(spec, SimpleNamespace(trajectory=config), None, {}))
        return World(flight_family(config), own, kind.home(spec), lambda m, p: kind.approaches(spec, m, p))
    arm = replace(spec_of(name), model_file=None)
    jerk = tuple(replace(axis, jerk=4.0 * axis.acceleration) for axis in arm.axes)
    arm = replace(arm, axes=jerk)
    own_limits = arm_limits(arm, {})
    if rest == "none":
        own_limits = tuple(replace(x, rest=False) if x.name == "velocity" else x for x in own_limits)  # type: ignore[type-var]
    fourier = FourierConfig(HARMONICS, DURATION, 2.0 * math.pi / DURATION, rest)  # type: ignore[arg-type]
    middle = 0.5 * (arm.lower + arm.upper)
    return World(arm_family(arm, fourier), own_limits, middle, lambda m, p: arm_ways(arm, m, p))


def spec_of(name: str) -> ArmSpec:
    if name in FILES:
        return robot_of(name)
    spec: ArmSpec = KIND.spec(KIND.built_in()[name])
    return spec


def seeds() -> range:
    first, last = (int(x) for x in os.environ.get("ETUDE_MOTIONS", "0:1").split(":"))
    return range(first, last)


def batch(everyday: bool) -> int:
    return 6 if everyday else int(os.environ.get("ETUDE_BATCH", "60"))


def drawn(place: World, seed: int, count: int) -> list[FourierTrajectory]:
    rng = np.random.default_rng([seed, 12])
    room = FeasibleSet.of(place.limits, place.family, place.home)
    each = -(-count // len(SAMPLERS))
    points = np.concatenate([sampler(rng, room, each) for sampler in SAMPLERS])[:count]
    return [place.family.trajectory(p) for p in points]  # type: ignore[misc]


def instants(piece: Trajectory) -> Iterator[Array]:
    """A hundred times as many as the proof of a series looks at, in chunks."""
    period = 2.0 * math.pi / piece.omega0 if isinstance(piece, FourierTrajectory) else piece.duration
    count = math.ceil(DENSER * OVERSAMPLING * HARMONICS * piece.duration / period) + 1
    for first in range(0, count, CHUNK):
        yield piece.duration * np.arange(first, min(first + CHUNK, count)) / (count - 1)


def violations(pieces: Sequence[Trajectory], limits: Sequence[Limit]) -> int:
    """How many proved rows samples leave, of pieces that share their instants: evaluated side by side."""
    left, axes = 0, pieces[0].motion(np.zeros(1), 1).orders.shape[2]
    found = [(limit, [limit.prove(piece) for piece in pieces]) for limit in limits]
    side = _side_by_side(pieces)
    for t in instants(pieces[0]):
        orders = side.motion(t, 4).orders
        flat = orders.reshape(4, len(t) * len(pieces), axes)
        for limit, rows in found:
            values = limit.of_motion(Motion(np.repeat(t, len(pieces)), flat))
            table = values.reshape(len(t), len(pieces), -1)
            low, high = table.min(axis=0), table.max(axis=0)
            for own, least, most in zip(rows, low, high, strict=True):
                left += sum(_left(row, a, b) for row, a, b in zip(own, least, most, strict=True))
    return left


def _left(row: object, low: float, high: float) -> bool:
    """Whether samples leave what a row proves."""
    if row.status != "proved":  # type: ignore[attr-defined]
        return False
    least, most = row.proved_lower, row.proved_upper  # type: ignore[attr-defined]
    slack = ROUNDING * max(1.0, abs(least), abs(most) if math.isfinite(most) else 1.0)
    return bool(low < least - slack or high > most + slack)


def _side_by_side(pieces: Sequence[Trajectory]) -> Trajectory:
    first = pieces[0]
    if not isinstance(first, FourierTrajectory):
        assert len(pieces) == 1
        return first
    table = np.concatenate([piece.coefficients for piece in pieces], axis=1)  # type: ignore[attr-defined]
    return replace(first, coefficients=table)


def of_form(place: World, form: str, seed: int, count: int) -> tuple[int, int]:
    """Motions, and rows that were left."""
    motions = drawn(place, seed, count)
    for motion in motions:
        assert certify(motion, place.limits).ok
    if form not in ("chain", "ways"):
        return len(motions), violations(motions, place.limits)
    left, made = 0, 0
    poses = [motion.motion(np.zeros(1), 1).orders[0, 0] for motion in motions]
    for one, other, pose in zip(motions[::2], motions[1::2], poses[::-1], strict=False):
        if form == "ways":
            pieces: Sequence[Trajectory] = place.way(one, pose)
        else:
            chain, _ = linked_chain([one, other], place.way, place.limits, place.home)
            assert certify(chain, place.limits).ok
            pieces = [piece for _, _, piece in chain.pieces()]
        made += len(pieces) if form == "ways" else 1
        for piece in pieces:
            if form != "ways" or certify(piece, place.limits).ok:
                left += violations([piece], place.limits)
    return made, left


@pytest.mark.parametrize(("name", "form"), EVERY_DAY)
def test_a_few_certified_motions_hold_what_is_proved(name: str, form: str) -> None:
    made, left = of_form(world(name, form), form, 7, 6)
    assert made >= 3
    assert left == 0


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", [*ARMS, *VEHICLES])
def test_certified_motions_hold_what_is_proved(name: str, form: str) -> None:
    if name in VEHICLES and form == "ramp":
        pytest.skip("flights have no phase ramps")
    place, made, left = world(name, form), 0, 0
    for seed in seeds():
        found = of_form(place, form, seed, batch(everyday=False))
        made, left = made + found[0], left + found[1]
    print(f"{name}, {form}: {made} motions, {left} rows left")
    assert left == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arm4", "mobile_arm", "panda", "ur5", "so100", "z1"])
def test_designed_motions_hold_what_is_proved(name: str) -> None:
    """With speeds in space; clearance is sampled elsewhere, and first flights are random."""
    kind, spec = KIND, spec_of(name)
    around = replace(spec.around, collision=replace(spec.around.collision, look=False))
    spec = replace(spec, around=around, cartesian=Cartesian(speed=0.8, radius=3.0))
    config = preset_config(kind, "default")
    inputs, limit = kind.inputs(spec, config), kind.limit(spec)
    own, allowed = kind.family(spec, config), kind.limits(spec, config, None, {})
    commands = next(c.parts for c in kind.channels(spec) if c.role == "command")
    known = prior_latents(inputs, kind.expected(spec).limits, limit, config.model, commands)
    assert known is not None
    quick, left, made = DesignConfig(candidates=4, refine=1, steps=10), 0, 0
    for seed in seeds():
        for number in range(3):
            rng = np.random.default_rng([seed, number])
            motion = design(own, allowed, kind.home(spec), inputs, known, quick, rng).trajectory
            assert certify(motion, allowed).ok
            made, left = made + 1, left + violations([motion], allowed)
    print(f"{name}, designed: {made} motions, {left} rows left")
    assert left == 0
