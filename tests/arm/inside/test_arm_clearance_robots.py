"""Real arms: designed motions that never touch anything, and how much of their speed is left.

ETUDE_MOTIONS=100:300 takes the motions of other seeds, or more; -s prints a line for each robot.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from loading_examples import bullet_robot, example_robot

from etude.design import DesignConfig, design
from etude.limits import certify
from etude.models import ExactGP, structured
from etude.protocols import Candidate, Posterior
from etude.trajectories import FourierConfig, FourierTrajectory
from etude.types import Array
from etude_arm import KIND, ArmInputs, ArmSpec
from etude_arm.clearance.clearance_limit import Clearance
from etude_arm.clearance.robot_clearance import search_of
from etude_arm.clearance.surroundings import Surroundings
from etude_arm.description import describe
from etude_arm.motions import family, limits

pytestmark = pytest.mark.slow
SECONDS = 60.0
LEAST = 1e-3
"""s between samples."""
FASTEST = 4.0


@dataclass(frozen=True)
class Robot:
    """A file, its joints, and the part of the speed that must be left."""

    file: str
    joints: tuple[str, ...] | None = None
    speed: float = 0.6
    bullet: bool = False

    def path(self) -> Path:
        return bullet_robot(self.file) if self.bullet else example_robot(self.file)


ROBOTS = {
    "panda": Robot("panda_description/urdf/panda.urdf"),
    "ur5": Robot("ur_description/urdf/ur5_robot.urdf", speed=0.35),
    "iiwa": Robot("kuka_iiwa/model.urdf", bullet=True),
    "xarm7": Robot("xarm_description/urdf/xarm7.urdf"),
    "so100": Robot("so_arm_description/urdf/so100.urdf"),
    "z1": Robot("z1_description/urdf/z1.urdf"),
    "tiago": Robot("tiago_description/robots/tiago_no_hand.urdf", ("arm_*_joint",)),
    "kinova": Robot("kinova_description/robots/kinova.urdf"),
}


@dataclass(frozen=True, eq=False)
class Known:
    """A model and its process as a design sees them."""

    inputs: ArmInputs
    candidates: tuple[Candidate, ...] = ()
    found: tuple[tuple[Posterior, tuple[int, ...]], ...] = ()

    def latents(self) -> tuple[tuple[Posterior, tuple[int, ...]], ...]:
        return self.found


def arm(name: str, folder: Path) -> tuple[ArmSpec, ArmSpec]:
    """The robot as `etude init` leaves it in a folder, and without shapes."""
    robot = ROBOTS[name]
    for file, data in describe(robot.path(), robot.joints).files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(data)
    spec = KIND.spec(folder / "robot.toml")
    axes = tuple(replace(a, velocity=min(a.velocity, FASTEST)) for a in spec.axes)
    axes = tuple(replace(a, acceleration=a.velocity / 0.5) for a in axes)
    spec = replace(spec, axes=axes)
    return spec, replace(spec, model_file=None, around=Surroundings())


def model(spec: ArmSpec, known: FourierTrajectory) -> Known:
    """One that has learned something of each joint from one motion."""
    inputs = ArmInputs.of(spec, 0.02)
    X = inputs.plan(known.motion(np.linspace(1.0, SECONDS, 40), inputs.orders)).X
    candidates = []
    for j, axis in enumerate(spec.names):
        kernel = structured(inputs.columns, (axis,))
        theta = kernel.initial(0.5 * np.ptp(X, axis=0) + 1e-3, 1.0)
        own = ExactGP(kernel, theta, math.log(0.03)).condition(X, np.sin(X[:, j]))
        units, one = np.array([[0.0], [1.0]]), np.ones(1)
        candidates.append(Candidate("gp", (j,), one, None, Known(inputs, found=((own, (0,)),)), units, one))
    return Known(inputs, tuple(candidates))


def designed(spec: ArmSpec, seed: int) -> FourierTrajectory:
    rng = np.random.default_rng(seed)
    own, allowed = family(spec, FourierConfig(duration=SECONDS)), limits(spec, {})
    home = search_of(spec)[0]
    first = own.trajectory(np.zeros(own.size))
    table = first.coefficients + 0.3 * rng.standard_normal(first.coefficients.shape)
    known = model(spec, FourierTrajectory(table, own.omega0, SECONDS))
    found = design(own, allowed, home, known.inputs, known, DesignConfig(criterion="info_gain"), rng)
    return found.trajectory  # type: ignore[return-value]


def speed(spec: ArmSpec, motions: Sequence[FourierTrajectory]) -> float:
    found = []
    for motion in motions:
        t = np.linspace(0.0, motion.duration, 1001)
        found.append(np.abs(motion.motion(t, 2).orders[1]).mean())
    return float(np.mean(found))


def nearest(limit: Clearance, motion: FourierTrajectory) -> Array:
    """(r,) m, every millisecond of one period: the others are the same path."""
    t = np.arange(0.0, 2.0 * math.pi / motion.omega0, LEAST)
    return limit.of_motion(motion.motion(t, 1)).min(axis=0)


def seeds() -> range:
    first, last = (int(x) for x in os.environ.get("ETUDE_MOTIONS", "0:4").split(":"))
    return range(first, last)


@pytest.mark.parametrize("name", ROBOTS)
def test_designed_motions_touch_nothing_and_keep_their_speed(name: str, tmp_path: Path) -> None:
    spec, bare = arm(name, tmp_path)
    allowed = limits(spec, {})
    limit = allowed[-1]
    assert isinstance(limit, Clearance)
    started, motions, least = process_time(), [], math.inf
    for seed in seeds():
        motions.append(designed(spec, seed))
    seconds = (process_time() - started) / len(motions)
    for motion in motions:
        certificate = certify(motion, allowed)
        assert certificate.ok
        proved = np.array([row.proved_lower for row in certificate.rows if row.quantity == "clearance"])
        found = nearest(limit, motion)
        least = min(least, float(found.min()))
        assert found.min() > 0.0, "they touch"
        assert np.all(proved <= found + 1e-9)
    free = [designed(bare, seed) for seed in list(seeds())[:20]]
    part = speed(spec, motions) / speed(spec, free)
    print(f"{name}: {len(motions)} motions, {seconds:.1f} s each, nearest {least:.4f} m, speed x {part:.2f}")
    assert part >= ROBOTS[name].speed


@pytest.mark.parametrize("name", ROBOTS)
def test_motions_through_a_collision_are_refused_with_pair_and_time(name: str, tmp_path: Path) -> None:
    """25 of each of eight robots, by 5 mm or more, at an instant that no sample knows."""
    spec, _ = arm(name, tmp_path)
    limit, rng = limits(spec, {})[-1], np.random.default_rng(7)
    assert isinstance(limit, Clearance)
    texts = np.array([gap.text for gap in limit.gaps.list])
    poses = rng.uniform(spec.lower, spec.upper, (2000, spec.dof))
    poses = poses[limit.gaps.of_poses(poses).min(axis=1) < -0.005][:25]
    assert len(poses) == 25
    for pose in poses:
        table = 0.1 * rng.standard_normal((7, spec.dof))
        path = FourierTrajectory(table, 1.0, 2.0 * math.pi)
        table[0] += pose - path.motion(rng.uniform(0.0, 6.0, 1), 1).orders[0, 0]
        motion = FourierTrajectory(table, 1.0, 2.0 * math.pi)
        failed = [row for row in limit.prove(motion) if not row.proved_lower >= row.lower]
        assert failed
        for row in failed:
            pair, _, time = row.where.rpartition(" at ")
            at = motion.motion(np.array([float(time.removesuffix(" s"))]), 1).orders[0]
            near = limit.gaps.of_poses(at)[0, texts == pair].min()
            assert near < row.lower + 0.01, "the time has three digits"
