"""MJCF text of a compiled model: bodies, masses, chosen joints and collision shapes in full precision."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.loading.attachments import Additions, Attached, Mounting, tip
from etude_arm.loading.hulls import hull, obj_text
from etude_arm.loading.inertia import ENTRIES
from etude_arm.loading.joint_choice import Choice
from etude_arm.loading.mjcf_compiled import SHAPES, joints_of, moving, name_of, shapes_of_bodies
from etude_arm.loading.parsing import free_name
from etude_arm.loading.rotations import turn_of

if TYPE_CHECKING:
    import mujoco

SIZES = {2: 1, 3: 2, 4: 3, 5: 2, 6: 3, 7: 0}  # numbers of each of SHAPES
SLIDE = 2  # mjtJoint
NO_GRAVITY = 1 << 7  # mjtDisableBit.mjDSBL_GRAVITY


@dataclass(frozen=True)
class Written:
    """The new file. `shapes` by name are geoms of the model; other attributes as of `loaded.Loaded`."""

    xml: str
    assets: Mapping[str, bytes]
    notes: tuple[str, ...]
    unverified: tuple[str, ...]
    excluded: tuple[tuple[str, str], ...]
    shapes: Mapping[str, int]
    added: Mapping[str, str]


@dataclass
class _Writer:
    """A writer that visits the bodies of a model once."""

    model: mujoco.MjModel
    choice: Choice
    assets: dict[str, bytes] = field(default_factory=dict)
    names: dict[int, list[str]] = field(default_factory=dict)  # geoms by the body that has them
    unverified: list[str] = field(default_factory=list)

    def body(self, parent: ET.Element, b: int, shapes: Mapping[int, Sequence[int]]) -> ET.Element:
        m = self.model
        new = ET.SubElement(parent, "body", name=name_of(m, b), gravcomp=repr(float(m.body_gravcomp[b])))
        at, quat = self._pose(b)
        new.set("pos", _text(at))
        new.set("quat", _text(quat))
        if m.body_mass[b] > 0:
            inertial = ET.SubElement(new, "inertial", mass=repr(float(m.body_mass[b])))
            for key, values in (
                ("pos", m.body_ipos),
                ("quat", m.body_iquat),
                ("diaginertia", m.body_inertia),
            ):
                inertial.set(key, _text(values[b]))
        for j in joints_of(m, b):
            if m.joint(j).name in self.choice.joints:
                self._joint(new, j)
        self.geoms(new, b, shapes.get(b, ()))
        return new

    def _pose(self, b: int) -> tuple[Array, Array]:
        """Position and quaternion in the parent's frame, with held joints at their positions."""
        m, moves = self.model, False
        at, quat = np.array(m.body_pos[b]), np.array(m.body_quat[b])
        for j in joints_of(m, b):
            name = m.joint(j).name
            if name in self.choice.joints:
                moves = True
            elif moves and name in self.choice.held:
                raise UsageError(
                    f"joint '{name}' cannot be fixed: one before it in its body moves",
                    next_step="Give it a separate body in the model file.",
                )
            elif name in self.choice.held:
                away = self.choice.held[name] - float(m.qpos0[m.jnt_qposadr[j]])
                at, quat = _displaced(m, j, away, at, quat)
        return at, quat

    def _joint(self, body: ET.Element, j: int) -> None:
        m = self.model
        dof, qpos = int(m.jnt_dofadr[j]), int(m.jnt_qposadr[j])
        new = ET.SubElement(body, "joint", name=m.joint(j).name)
        new.set("type", "slide" if m.jnt_type[j] == SLIDE else "hinge")
        for key, values in (("pos", m.jnt_pos[j]), ("axis", m.jnt_axis[j])):
            new.set(key, _text(values))
        for key, value in (
            ("ref", m.qpos0[qpos]),
            ("springref", m.qpos_spring[qpos]),
            ("stiffness", _first(m.jnt_stiffness[j])),
            ("armature", m.dof_armature[dof]),
            ("damping", _first(m.dof_damping[dof])),
            ("frictionloss", m.dof_frictionloss[dof]),
        ):
            new.set(key, repr(float(value)))
        if m.jnt_limited[j]:
            new.set("range", _text(m.jnt_range[j]))
        if m.jnt_actfrclimited[j]:
            new.set("actuatorfrcrange", _text(m.jnt_actfrcrange[j]))

    def geoms(self, body: ET.Element, b: int, shapes: Sequence[int]) -> None:
        m, name = self.model, name_of(self.model, b)
        for k, g in enumerate(shapes):
            kind = int(m.geom_type[g])
            new = ET.SubElement(body, "geom", name=f"{name}#{k}", type=SHAPES[kind])
            new.set("pos", _text(m.geom_pos[g]))
            new.set("quat", _text(m.geom_quat[g]))
            if SIZES[kind]:
                new.set("size", _text(m.geom_size[g][: SIZES[kind]]))
            else:
                new.set("mesh", self._mesh(int(m.geom_dataid[g])))
            self.names.setdefault(b, []).append(f"{name}#{k}")

    def _mesh(self, mesh: int) -> str:
        """The name of a mesh's hull."""
        m, name = self.model, f"{mesh}_hull"
        if f"{name}.obj" not in self.assets:
            first = int(m.mesh_vertadr[mesh])
            points = m.mesh_vert[first : first + int(m.mesh_vertnum[mesh])].astype(float)
            self.assets[f"{name}.obj"] = obj_text(*hull(points))
        return name


def _displaced(m: mujoco.MjModel, j: int, away: float, at: Array, quat: Array) -> tuple[Array, Array]:
    """The pose of a body after its joint j, displaced by `away` from its reference; a hinge rotates about its
    anchor.
    """
    import mujoco

    if m.jnt_type[j] == SLIDE:
        return at + _turned(m.jnt_axis[j] * away, quat), quat
    turn, after = np.zeros(4), np.zeros(4)
    mujoco.mju_axisAngle2Quat(turn, m.jnt_axis[j], away)
    mujoco.mju_mulQuat(after, quat, turn)
    return at + _turned(m.jnt_pos[j], quat) - _turned(m.jnt_pos[j], after), after


def _turned(vector: Array, quat: Array) -> Array:
    import mujoco

    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, vector, quat)
    return turned


ON_JOINT, ON_TENDON = (0, 1), 3  # mjtTrn: joint, joint in parent; tendon
WRAP_JOINT, WRAP_SITE = 1, 3  # mjtWrap


def add_drives(
    model: mujoco.MjModel, joints: Sequence[str], root: ET.Element, bodies: Mapping[int, ET.Element]
) -> None:
    """Adds motors of the chosen joints, and those on tendons of chosen joints or of sites."""
    tendons, motors = ET.SubElement(root, "tendon"), ET.SubElement(root, "actuator")
    for k in range(model.nu):
        kind, target = int(model.actuator_trntype[k]), int(model.actuator_trnid[k, 0])
        gear = repr(float(model.actuator_gear[k, 0]))
        if kind in ON_JOINT and model.joint(target).name in joints:
            ET.SubElement(motors, "motor", joint=model.joint(target).name, gear=gear)
        elif kind == ON_TENDON and _tendon(model, target, joints, tendons, bodies):
            ET.SubElement(motors, "motor", tendon=f"tendon{target}", gear=gear)


def _tendon(
    model: mujoco.MjModel,
    t: int,
    joints: Sequence[str],
    tendons: ET.Element,
    bodies: Mapping[int, ET.Element],
) -> bool:
    """Writes a tendon over joints or through sites; returns False for one with pulleys or wrapping geoms."""
    first = int(model.tendon_adr[t])
    wraps = range(first, first + int(model.tendon_num[t]))
    kinds, objects = {int(model.wrap_type[w]) for w in wraps}, [int(model.wrap_objid[w]) for w in wraps]
    if any(part.get("name") == f"tendon{t}" for part in tendons):
        return True
    if kinds == {WRAP_JOINT}:
        names = [model.joint(j).name for j in objects]
        if not set(names) & set(joints):
            return False
        fixed = ET.SubElement(tendons, "fixed", name=f"tendon{t}")
        for name, w in zip(names, wraps, strict=True):
            if name in joints:
                ET.SubElement(fixed, "joint", joint=name, coef=repr(float(model.wrap_prm[w])))
        return True
    if kinds != {WRAP_SITE}:
        return False
    spatial = ET.SubElement(tendons, "spatial", name=f"tendon{t}")
    for site in objects:
        body = bodies[int(model.site_bodyid[site])]
        if not any(part.get("name") == f"site{site}" for part in body.findall("site")):
            at = " ".join(repr(float(x)) for x in model.site_pos[site])
            ET.SubElement(body, "site", name=f"site{site}", pos=at)
        ET.SubElement(spatial, "site", site=f"site{site}")
    return True


def mounted(world: ET.Element, mounting: Mounting) -> ET.Element:
    """The frame in the world that contains the robot."""
    return ET.SubElement(world, "frame", pos=_text(mounting.position), quat=_text(_quaternion(mounting.turn)))


def add_carried(body: ET.Element, name: str, one: Attached) -> None:
    """Adds a tool or payload under an unused name to the body that carries it."""
    new, moments = ET.SubElement(body, "body", name=name), one.moments()
    full = _text(moments[i, j] for _, i, j in ENTRIES)
    ET.SubElement(new, "inertial", pos=_text(one.centre), mass=repr(one.mass), fullinertia=full)
    if one.shape != "none":
        radius, *length = one.size
        half = [value / 2 for value in one.size] if one.shape == "box" else [radius, *(x / 2 for x in length)]
        geom = ET.SubElement(new, "geom", name=f"{name}#0", type=one.shape, size=_text(half))
        geom.set("pos", _text(one.shape_centre or one.centre))
        geom.set("quat", _text(_quaternion(turn_of(*one.rotation))))


def _quaternion(turn: Array) -> Array:
    import mujoco

    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, turn.reshape(-1))
    return quat


def written(model: mujoco.MjModel, choice: Choice, drives: bool, added: Additions) -> Written:
    """A model of the chosen joints; `drives`: with the actuators, and the tendons that they pull.

    Raises:
        UsageError: a joint that shares its body with a moving one cannot be held.
    """
    writer = _Writer(model, choice)
    root = ET.Element("mujoco", model="robot")
    ET.SubElement(root, "compiler", angle="radian", fusestatic="true", inertiafromgeom="false")
    gravity = np.zeros(3) if model.opt.disableflags & NO_GRAVITY else model.opt.gravity
    ET.SubElement(root, "option", gravity=_text(gravity), timestep=repr(float(model.opt.timestep)))
    asset, world = ET.SubElement(root, "asset"), ET.SubElement(root, "worldbody")
    if added.mounting is not None:
        world = mounted(world, added.mounting)
    shapes, notes = shapes_of_bodies(model, choice, writer.unverified)
    elements = {0: world}
    writer.geoms(world, 0, shapes.get(0, ()))
    for b in range(1, model.nbody):
        elements[b] = writer.body(elements[int(model.body_parentid[b])], b, shapes)
    bodies = [name_of(model, b) for b in range(model.nbody)]
    carried = {what: free_name(what, bodies) for what, _ in added.carried}
    for what, one in added.carried:
        add_carried(elements[_carrier(model, choice, what, one)], carried[what], one)
    for name in writer.assets:
        ET.SubElement(asset, "mesh", name=name.removesuffix(".obj"), file=name)
    if drives:
        add_drives(model, choice.joints, root, elements)
    xml = ET.tostring(root, encoding="unicode")
    names = {
        name: g
        for b, geom_names in writer.names.items()
        for name, g in zip(geom_names, shapes[b], strict=True)
    }
    excluded = _excluded(model, writer.names)
    return Written(xml, writer.assets, notes, tuple(writer.unverified), excluded, names, carried)


def _carrier(model: mujoco.MjModel, choice: Choice, what: str, one: Attached) -> int:
    """The body that carries a tool or a payload."""
    if not one.link:
        return int(model.jnt_bodyid[model.joint(tip(moving(model), choice.joints, what)).id])
    names = [name_of(model, b) for b in range(model.nbody)]
    if one.link not in names:
        raise UsageError(
            f"there is no body '{one.link}'",
            where=f"[{what}]",
            next_step=f"Its bodies are {', '.join(names)}.",
        )
    return names.index(one.link)


def _excluded(model: mujoco.MjModel, names: Mapping[int, Sequence[str]]) -> tuple[tuple[str, str], ...]:
    """Pairs of geoms whose bodies the file excludes from contact."""
    pairs = []
    for signature in model.exclude_signature:
        one, other = int(signature) >> 16, int(signature) & 0xFFFF
        pairs += [(a, b) for a in names.get(one, ()) for b in names.get(other, ())]
    return tuple(pairs)


def _first(value: float | Array) -> float:
    return float(np.ravel(value)[0])


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in values)
