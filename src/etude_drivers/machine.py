"""A MuJoCo model as a robot: its position controller, friction, delay, and masses that the campaign lacks.

It is loaded by MuJoCo's own parser, not by Étude's, and joints go by name, so that it is as independent of
what Étude computes as a simulation can be. It is not clean on purpose.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from etude.drivers import require_known
from etude.errors import UsageError
from etude.types import Array, Index

BRAKES = 0.2
"""s of braking, at constant deceleration, of a joint that gets no set-points any more."""
LONGEST_BRAKING, STILL = 0.8, 2e-3
"""s from a stop to rest with what the feedback needs; rad/s or m/s that count as rest."""
SETTLING = 1.0
"""s from a pose to rest in the feedback."""
LATE_CYCLES = 2.0
"""Set-points go on in time for so many cycles when the next one does not come."""
LONGEST_STEP, SHORTEST_STEP = 1e-3, 2e-4
"""s of physics."""
STABLE = 0.4
"""rad that the fastest mode goes on in one step."""
HELD = 1e7
"""Damping and inertia of joints that are not the campaign's."""
SAG = 0.02
"""rad or m by which gravity and friction move a joint off its set-point, at most."""
RESERVED = "world"
"""MuJoCo's name of its fixed body."""
STRIBECK = 0.05
"""rad/s or m/s at which stiction has fallen to 1/e."""


@dataclass(frozen=True)
class MachineSettings:
    """Of the table [driver].

    Attributes:
        model: URDF or MJCF. rate: Hz of set-points and samples.
        start: pose at the beginning by name, rad or m; else the campaign's home. Joints that it leaves out,
            and all without a campaign: 0, or the middle of a range without it.
        bandwidth: Hz of the position controller.
        friction, viscous: Coulomb friction, and friction at 1 rad/s, in parts of what gravity and an
            acceleration of 1 rad/s^2 ask of the joint at most. stiction: what Coulomb friction is more at
            rest, as a part of it.
        wrong_masses: masses and inertias are up to this part off the model's. payload: kg at the last body.
        delay: s of set-points. noise: rad or m of measured positions. seed: of both and of masses.
        adds_gravity: the robot holds its (wrong) weight itself, and its commands are without it.
        virtual: its clock moves on with each set-point. view: shows it in a window.
    """

    model: str = ""
    rate: float = 250.0
    start: Mapping[str, float] | None = None
    bandwidth: float = 4.0
    friction: float = 0.05
    viscous: float = 0.02
    stiction: float = 0.0
    wrong_masses: float = 0.0
    payload: float = 0.0
    delay: float = 0.0
    noise: float = 1e-5
    seed: int = 0
    adds_gravity: bool = False
    virtual: bool = False
    view: bool = False

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> MachineSettings:
        """UsageError: an unknown key, or values that make no robot."""
        keys = [setting.name for setting in fields(cls)]
        require_known(table, keys, "mujoco")
        made = cls(**table)
        if not (
            made.rate > 0
            and made.bandwidth > 0
            and min(made.friction, made.viscous, made.stiction, made.delay) >= 0
        ):
            raise UsageError(
                "rate and bandwidth have to be positive, and friction, viscous, stiction and delay not "
                "negative",
                where="run.toml [driver]",
                next_step="Give such numbers.",
            )
        return made


class Machine:
    """The robot: `cycle` moves it on by one set-point's time.

    Attributes:
        t: its clock, s. q, qd, asked, command: (J,) in the order of the joints; command is what the drives
            applied, mean of the last cycle.
    """

    def __init__(self, joints: Sequence[str], settings: MachineSettings) -> None:
        self.joints, self.settings = tuple(joints), settings
        self.model = compiled(Path(settings.model))
        self.data = mujoco.MjData(self.model)
        self._places, self._dofs = self._joint_indices()
        self._rng = np.random.default_rng(settings.seed)
        self._set_start(settings.start or {})
        self.stiffness, self.damping = self._gains()
        self._add_mismatch()
        self.period = 1.0 / settings.rate
        self.parts = int(np.ceil(self.period / self.model.opt.timestep - 1e-9))
        self.model.opt.timestep = self.period / self.parts
        self.effort_limit = self._effort_limits()
        self._zero = np.zeros(len(self.joints))
        self._weight = mujoco.MjData(self.model) if settings.adds_gravity else None
        self.place(settings.start or {})

    def place(self, pose: Mapping[str, float]) -> None:
        """Stands at that pose, rad or m by joint; joints that it leaves out as `MachineSettings.start`."""
        self._set_start(pose)
        self.t = 0.0
        self.asked = self.data.qpos[self._places].copy()
        self.command = self._zero.copy()
        self._reference = self.asked.copy(), self._zero, self._zero, self._zero
        self._age, self._follows = np.inf, True
        self._queue: deque[tuple[float, tuple[Array, Array, Array, Array]]] = deque()

    def settle(self) -> None:
        """Simulate until it rests in its feedback, then start its clock."""
        for _ in range(int(SETTLING / self.period)):
            self.cycle()
        self.t = 0.0

    @property
    def q(self) -> Array:
        """(J,) as measured."""
        noise = self.settings.noise * self._rng.standard_normal(len(self.joints))
        measured: Array = self.data.qpos[self._places] + noise
        return measured

    @property
    def qd(self) -> Array:
        """(J,)"""
        velocity: Array = self.data.qvel[self._dofs].copy()
        return velocity

    @property
    def limits(self) -> tuple[Array, Array]:
        """(J,) stops; infinite where there are none."""
        index = [self.model.joint(name).id for name in self.joints]
        limited = self.model.jnt_limited[index].astype(bool)
        low, high = self.model.jnt_range[index].T
        return np.where(limited, low, -np.inf), np.where(limited, high, np.inf)

    def ask(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        """A set-point (J,) for the end of the next cycle, or the delay later; none after a stop."""
        if self._follows:
            added = self._zero if effort is None else effort
            self._queue.append((self.t + self.settings.delay, (q, qd, qdd, added)))

    def ready(self) -> None:
        """Follows set-points again."""
        self._follows = True

    def stop(self, kill: bool = False) -> None:
        """Brakes to rest and holds there; kill: where it is now. Set-points count again after `ready`."""
        if self._follows or kill:
            self._queue.clear()
            q, qd = self._current_reference()
            if kill:
                q, qd = self.data.qpos[self._places].copy(), self._zero
            late = LATE_CYCLES * self.period
            self._reference = q - late * qd, qd, self._zero, self._reference[3]
            self._age, self._follows = late, False

    def rest(self) -> None:
        """Time passes until it stands still."""
        for _ in range(int(LONGEST_BRAKING / self.period)):
            if np.abs(self.data.qvel[self._dofs]).max() < STILL:
                break
            self.cycle()

    def cycle(self) -> None:
        """One cycle on."""
        while self._queue and self._queue[0][0] <= self.t + 1e-9:
            self._reference, self._age = self._queue.popleft()[1], -self.period
        total = self._zero.copy()
        for _ in range(self.parts):
            total += self._step()
        self.t += self.period
        self.asked = self._current_reference()[0]
        self.command = total / self.parts

    def _step(self) -> Array:
        q, qd = self._current_reference()
        effort: Array
        apart = q - self.data.qpos[self._places]
        slip = qd - self.data.qvel[self._dofs]
        effort = self.stiffness * apart + self.damping * slip + self._reference[3]
        effort = np.clip(effort, -self.effort_limit, self.effort_limit)
        # the velocity's part of the feedback is the model's damping, which MuJoCo integrates implicitly
        added = self.damping * self.data.qvel[self._dofs] + (0.0 if self._weight is None else self._gravity())
        self.data.qfrc_applied[self._dofs] = effort + added
        if self.settings.stiction:
            slow = np.exp(-((self.data.qvel[self._dofs] / STRIBECK) ** 2))
            self.model.dof_frictionloss[self._dofs] = self._coulomb * (1.0 + self.settings.stiction * slow)
        mujoco.mj_step(self.model, self.data)
        self._age += self.model.opt.timestep
        return effort

    def _current_reference(self) -> tuple[Array, Array]:
        """The set-point in force, carried on in time; from one that is old it brakes to rest."""
        q, qd, qdd, _ = self._reference
        usual = min(self._age, LATE_CYCLES * self.period)
        over = self._age - usual
        now, speed = q + usual * (qd + 0.5 * usual * qdd), qd + usual * qdd
        over = min(max(over, 0.0), BRAKES)
        return now + over * (1.0 - 0.5 * over / BRAKES) * speed, (1.0 - over / BRAKES) * speed

    def _gravity(self) -> Array:
        """(J,) what holds its weight where it is."""
        assert self._weight is not None
        self._weight.qpos[:] = self.data.qpos
        mujoco.mj_kinematics(self.model, self._weight)
        mujoco.mj_comPos(self.model, self._weight)
        force = np.zeros(self.model.nv)
        mujoco.mj_rne(self.model, self._weight, 0, force)
        held: Array = force[self._dofs]
        return held

    def _joint_indices(self) -> tuple[Index, Index]:
        """Places of the joints in qpos and qvel; the others are held."""
        named = {self.model.joint(i).name: i for i in range(self.model.njnt)}
        lacking = [name for name in self.joints if name not in named]
        single = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        moving = [name for name, i in named.items() if self.model.jnt_type[i] in single]
        if lacking:
            raise UsageError(
                f"the model has no joint {', '.join(lacking)}",
                where=self.settings.model,
                next_step=f"It has {', '.join(moving)}; the campaign's joints go by these names.",
            )
        index = [named[name] for name in self.joints]
        held = np.ones(self.model.nv, dtype=bool)
        held[self.model.jnt_dofadr[index]] = False
        self.model.dof_armature[held] += HELD
        self.model.dof_damping[held] += HELD
        return self.model.jnt_qposadr[index], self.model.jnt_dofadr[index]

    def _set_start(self, pose: Mapping[str, float]) -> None:
        low, high = self.limits
        middle = 0.5 * (np.maximum(low, -10) + np.minimum(high, 10))
        start = np.where((low < 0) & (high > 0), 0.0, middle)
        for name, value in pose.items():
            if name not in self.joints:
                raise UsageError(f"start names {name!r}, which is not one of {', '.join(self.joints)}")
            start[self.joints.index(name)] = value
        self.data.qpos[self._places], self.data.qvel[:] = start, 0.0
        mujoco.mj_forward(self.model, self.data)

    def _gains(self) -> tuple[Array, Array]:
        """(J,) of position and velocity, by inertia and weight over the range; a step that suits them."""
        low, high = (np.clip(end, -np.pi, np.pi) for end in self.limits)
        other = mujoco.MjData(self.model)
        other.qpos[:] = self.data.qpos
        full, weight = [], []
        for _ in range(30):
            other.qpos[self._places] = self._rng.uniform(low, high)
            mujoco.mj_forward(self.model, other)
            mass = np.zeros((self.model.nv, self.model.nv))
            mujoco.mj_fullM(self.model, other, mass)
            full.append(mass[np.ix_(self._dofs, self._dofs)])
            weight.append(np.abs(other.qfrc_bias[self._dofs]))
        drag = self.model.dof_frictionloss[self._dofs] + self.model.dof_damping[self._dofs]  # at 1 rad/s
        heavy, load = np.max([np.diag(matrix) for matrix in full], axis=0), np.max(weight, axis=0) + drag
        self._scale = load + heavy
        stiffness = np.maximum(heavy * (2 * np.pi * self.settings.bandwidth) ** 2, 1.2 * load / SAG)
        # drives have inertia of their own; without some of it no controller of this rate is stable
        self.model.dof_armature[self._dofs] += stiffness * (SHORTEST_STEP / STABLE) ** 2
        fastest = max(
            float(np.linalg.eigvals(np.linalg.solve(matrix, np.diag(stiffness))).real.max())
            for matrix in full
        )
        self.model.opt.timestep = float(np.clip(STABLE / np.sqrt(fastest), SHORTEST_STEP, LONGEST_STEP))
        return stiffness, 1.4 * np.sqrt(stiffness * heavy)

    def _add_mismatch(self) -> None:
        """What the campaign's model does not know."""
        settings = self.settings
        self._coulomb = self.model.dof_frictionloss[self._dofs] + settings.friction * self._scale
        self.model.dof_frictionloss[self._dofs] = self._coulomb
        self.model.dof_damping[self._dofs] += settings.viscous * self._scale + self.damping
        factors = 1.0 + settings.wrong_masses * self._rng.uniform(-1.0, 1.0, self.model.nbody)
        self.model.body_mass[:] *= factors
        self.model.body_inertia[:] *= factors[:, None]
        last = self.model.jnt_bodyid[self.model.joint(self.joints[-1]).id]
        self.model.body_mass[last] += settings.payload
        mujoco.mj_setConst(self.model, self.data)

    def _effort_limits(self) -> Array:
        index = [self.model.joint(name).id for name in self.joints]
        limited = self.model.jnt_actfrclimited[index].astype(bool)
        limits: Array = np.where(limited, self.model.jnt_actfrcrange[index, 1], np.inf)
        return limits


def compiled(path: Path) -> Any:
    """The model of a URDF or an MJCF. Shapes of a URDF are left out: its masses stand beside them.

    Raises:
        UsageError: no such file, or none that MuJoCo reads.
    """
    step = "Name a URDF or an MJCF: --on mujoco:MODEL, or model = in [driver] of run.toml."
    if not path.is_file():
        raise UsageError(
            "there is no such model", where=str(path) if str(path) != "." else "", next_step=step
        )
    try:
        root = ElementTree.parse(path).getroot()
        spec = _of_urdf(root) if root.tag == "robot" else mujoco.MjSpec.from_file(str(path))
        spec.option.disableflags |= (
            mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
        )
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        return spec.compile()
    except (ElementTree.ParseError, ValueError, RuntimeError, mujoco.FatalError) as error:
        raise UsageError(f"MuJoCo cannot read it: {error}", where=str(path), next_step=step) from error


def _of_urdf(root: ElementTree.Element) -> Any:
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for inertia in root.iter("inertia"):
        _make_possible(inertia)
    _free_reserved_name(root)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-6, 1e-9
    spec.compiler.balanceinertia = True
    return spec


def _free_reserved_name(root: ElementTree.Element) -> None:
    """MuJoCo takes any link called world for its own fixed body, and loses the joint that mounts it."""
    new = RESERVED
    while any(link.get("name") == new for link in root.iter("link")):
        new = f"own_{new}"
    ends = [end for joint in root.iter("joint") for end in joint if end.tag in ("parent", "child")]
    for element, key in [*((link, "name") for link in root.iter("link")), *((end, "link") for end in ends)]:
        if element.get(key) == RESERVED:
            element.set(key, new)


def _make_possible(inertia: ElementTree.Element) -> None:
    """Moments of inertia that no body has are made those of the nearest one; MuJoCo refuses them."""
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    tensor = np.zeros((3, 3))
    upper = np.triu_indices(3)
    tensor[upper] = [float(inertia.get(name, "0")) for name in names]
    size, axes = np.linalg.eigh(tensor + np.triu(tensor, 1).T)
    if size[0] <= 0.0:
        whole = axes @ np.diag(np.maximum(size, max(1e-3 * size[2], 1e-9))) @ axes.T
        for name, value in zip(names, whole[upper], strict=True):
            inertia.set(name, repr(float(value)))
