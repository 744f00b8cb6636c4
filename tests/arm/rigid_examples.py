"""A deliberately awkward robot and random motions, for the tests of the rigid-body models."""

from __future__ import annotations

import numpy as np

from etude.types import Log, Samples
from etude_arm import ArmSpec, Axis

NAMES = ("turn", "slide", "tilt", "reach", "lone")

# Skew axes off the body origins, a sliding joint, two joints on one body, a body without joint, a second
# branch, a non-zero joint reference, tilted gravity; a drive between sites, one that couples joints, gears.
AWKWARD = """
<mujoco><option gravity="1 -2 -9.81"><flag contact="disable"/></option><worldbody>
  <body name="a" pos="0 .1 .3" euler="10 20 30">
    <joint name="turn" axis="0 .3 1" pos=".1 0 .05" ref="20"/>
    <geom type="box" size=".1 .2 .05" pos=".1 .1 .2" euler="5 6 7" mass="3"/>
    <site name="s1" pos=".1 .1 -.1"/>
    <body name="b" pos=".3 0 .1" euler="30 0 9">
      <joint name="slide" type="slide" axis="1 .2 0" pos="0 .1 0"/>
      <joint name="tilt" axis="0 1 .2" pos="0 .1 .2"/>
      <geom type="capsule" size=".05 .2" pos="0 .1 .2" mass="2"/>
      <body name="c" pos=".3 .1 .1" euler="3 40 9">
        <geom type="box" size=".1 .05 .2" pos=".2 .1 .2" mass="2.5"/>
        <body name="d" pos=".3 .2 .1" euler="30 40 90">
          <joint name="reach" axis="1 1 .2" pos="0 .1 .2"/>
          <geom type="box" size=".1 .15 .2" pos=".2 .1 .2" mass="1.5"/>
          <site name="s2" pos=".05 .1 .1"/>
        </body>
      </body>
    </body>
  </body>
  <body name="e" pos="1 0 0">
    <joint name="lone" axis="0 1 0"/><geom type="box" size=".1 .15 .2" pos=".2 .1 .2" mass="1.5"/>
    <body name="gripper" pos="0 0 .2"><joint name="finger" axis="1 0 0"/><geom size=".1" mass=".3"/></body>
  </body>
</worldbody>
<tendon>
  <spatial name="rod"><site site="s1"/><site site="s2"/></spatial>
  <fixed name="belt"><joint joint="turn" coef="2"/><joint joint="tilt" coef="-.5"/></fixed>
</tendon>
<actuator>
  <motor name="rod" tendon="rod" gear="-3"/><motor name="belt" tendon="belt"/>
  <motor name="lone" joint="lone" gear="5"/><motor name="slide" joint="slide" gear="2"/>
</actuator></mujoco>
"""
ACTUATOR_OF_AXIS = {"turn": "belt", "slide": "slide", "reach": "rod", "lone": "lone"}


def awkward_spec() -> ArmSpec:
    return ArmSpec("awkward", tuple(Axis(name, -1.0, 1.0, 1.0, 3.0, 100.0) for name in NAMES), "A", 10.0)


def smooth_motion(rng: np.random.Generator, samples: int, dof: int, step: float = 0.1):
    """t (n,), q, qd, qdd (n, dof) of sums of sines within about 1 rad and 1 rad/s."""
    t = step * np.arange(samples)
    speed, phase = rng.uniform(0.2, 1.0, (4, dof)), rng.uniform(0, 6.28, (4, dof))
    size = rng.uniform(0.05, 0.25, (4, dof))
    angle = t[:, None, None] * speed + phase
    q = np.sum(size * np.sin(angle), axis=1)
    qd = np.sum(size * speed * np.cos(angle), axis=1)
    return t, q, qd, -np.sum(size * speed**2 * np.sin(angle), axis=1)


def samples_of(model, rng: np.random.Generator, samples: int, noise: float, group: int = 0) -> Samples:
    """Noisy commands of a `RigidBodyModel` along a smooth motion, masked below 0.015 rad/s."""
    t, q, qd, qdd = smooth_motion(rng, samples, len(NAMES))
    command = model.predict(q, qd, qdd) + noise * rng.normal(size=q.shape)
    channels = {c.name: c for c in awkward_spec().channels()}
    values = {"q": q, "qd": qd, "qdd": qdd, "command": command}
    log = Log(t, {name: channels[name] for name in values}, values)
    moving = np.abs(qd) >= 0.015
    return Samples(log, np.full(samples, group, dtype=np.int64), np.ones_like(moving), moving)


def motion_of(samples: Samples) -> tuple[np.ndarray, ...]:
    """q, qd, qdd (n, dof)."""
    return samples.log["q"], samples.log["qd"], samples.log["qdd"]
