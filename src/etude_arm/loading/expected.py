"""Facts of a description at one pose, evaluated apart from the compiled model.

`urdf_expected` here and `mjcf.mjcf_expected` compute them; `compiled_model_check` compares the compiled model
with them.

It shares no code with the writer for MuJoCo (`urdf`), so that an error in one of the two is detected.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array, Index, Mask
from etude_arm.loading.attachments import Additions, Attached
from etude_arm.loading.inertia import NO_MASS, SMALLEST
from etude_arm.loading.joint_choice import Choice
from etude_arm.loading.parsing import free_name

if TYPE_CHECKING:
    pass

SEED = 29
"""Seed of the pose: the same pose in every run, and no special pose of a file."""
ANGLE, STROKE = 2.0, 0.2
"""rad and m on both sides of 0; joint limits do not matter to the comparison."""


@dataclass(frozen=True, eq=False)
class Place:
    """A shape in the room.

    Attributes:
        kind: "mesh" or MuJoCo's word. centre: (3,) m, of a mesh its file's origin. turn: (3, 3).
        size: m. Box: half of each side. Cylinder and capsule: radius and half the length. Sphere: radius. ():
            other shapes.
        needed: whether the compiled model must have this shape.
    """

    kind: str
    centre: Array
    turn: Array
    size: tuple[float, ...] = ()
    needed: bool = False


@dataclass(frozen=True, eq=False)
class Expected:
    """Facts of a description at the pose q (J,), in SI and in the frame of the room, whose z points up.

    Attributes:
        q: the pose, rad (m). joints: names. slides: (J,) True for sliding joints.
        gravity: (3,). base: (4, 4) pose of the description's base.
        anchor, axis: (J, 3) of each joint. frame: (J, 4, 4) of the link or body that it moves.
        moves: (J, J) whether joint j moves what joint i moves, at [i, j].
        mass, centre: (J,) and (J, 3) of what moves as one with each joint, with tool and payload.
        inertia: (J, 3, 3) about the centre of mass; NaN where the file states an impossible inertia.
        carried: tool, payload -> kg, which `mass` includes.
        shapes: link or body, tool or payload -> the possible poses of its shapes.
    """

    q: Array
    joints: tuple[str, ...]
    slides: Mask
    gravity: Array
    base: Array
    anchor: Array
    axis: Array
    frame: Array
    moves: Mask
    mass: Array
    centre: Array
    inertia: Array
    carried: Mapping[str, float]
    shapes: Mapping[str, tuple[Place, ...]]

    @property
    def weight(self) -> Array:
        """(J,) torques and forces that hold the robot at rest at q, N m (N), from masses and lever arms
        alone.
        """
        torques = np.zeros(len(self.joints))
        for j, (axis, anchor) in enumerate(zip(self.axis, self.anchor, strict=True)):
            for i in np.flatnonzero(self.moves[:, j]):
                force = self.mass[i] * self.gravity
                lever = np.cross(self.centre[i] - anchor, force)
                torques[j] -= axis @ (force if self.slides[j] else lever)
        return torques


def pose_of_joints(slides: Mask) -> Array:
    """(J,) the pose at which models are compared."""
    even = np.random.default_rng(SEED).uniform(-1.0, 1.0, len(slides))
    return np.asarray(even * np.where(slides, STROKE, ANGLE))


def gathered(parts: list[tuple[int, float, Array, Array]], joints: int) -> tuple[Array, Array, Array]:
    """Mass (J,), centre (J, 3) and inertia (J, 3, 3) about it of each joint's part, of bodies.

    Args:
        parts: joint, kg, centre (3,) and inertia about it (3, 3), the last two in the frame of the room.
        joints: J.
    """
    mass, moment = np.zeros(joints), np.zeros((joints, 3))
    for j, kg, at, _ in parts:
        mass[j] += kg
        moment[j] += kg * at
    centre = moment / np.maximum(mass, np.finfo(float).tiny)[:, None]
    inertia = np.zeros((joints, 3, 3))
    for j, kg, at, body_inertia in parts:
        away = at - centre[j]
        inertia[j] += body_inertia + kg * (away @ away * np.eye(3) - np.outer(away, away))
    return mass, centre, inertia


def chain_matrix(before: Index) -> Mask:
    """(J, J) `moves` of the joint that carries each, -1 at the base."""
    moves = np.eye(len(before), dtype=np.bool_)
    for i in range(len(before)):
        at = int(before[i])
        while at >= 0:
            moves[i, at] = True
            at = int(before[at])
    return moves


GRAVITY = (0.0, 0.0, -9.81)
"""m/s^2: URDF cannot state gravity; this is MuJoCo's default, too."""


@dataclass(frozen=True, eq=False)
class _Links:
    """Poses (4, 4) of links in the room, and the index of the chosen joint that moves each; -1 for the
    base.
    """

    pose: Mapping[str, Array]
    joint: Mapping[str, int]


def urdf_expected(root: ET.Element, choice: Choice, added: Additions) -> Expected:
    """The facts of a parsed <robot> with its chosen joints and additions."""
    elements = {one.get("name", ""): one for one in root.findall("joint")}
    names = {name: j for j, name in enumerate(choice.joints)}
    slides = np.array([elements[name].get("type") == "prismatic" for name in choice.joints])
    q = pose_of_joints(slides)
    base = (
        np.eye(4) if added.mounting is None else pose_matrix(added.mounting.position, added.mounting.rotation)
    )
    values = {**choice.held, **dict(zip(choice.joints, q.tolist(), strict=True))}
    links = _placed(list(elements.values()), values, names, base)
    carried = {what: _carrier(one, elements, links, choice.joints) for what, one in added.carried}
    before = np.array([links.joint[_end(elements[name], "parent")] for name in choice.joints])
    parts = _parts(root, links)
    for what, one in added.carried:
        parts += _weighing(links, carried[what], one.mass, _at(one.centre), one.moments())
    mass, centre, inertia = gathered(parts, len(q))
    places = {link.get("name", ""): _places(link, links) for link in root.findall("link")}
    taken = set(links.pose)
    for what, one in added.carried:
        places[free_name(what, taken)] = carried_place(one, links.pose[carried[what]])
    frame = np.array([links.pose[_end(elements[name], "child")] for name in choice.joints]).reshape(-1, 4, 4)
    axis = [frame[j, :3, :3] @ _axis(elements[name]) for name, j in names.items()]
    return Expected(
        q=q,
        joints=choice.joints,
        slides=slides,
        gravity=np.array(GRAVITY),
        base=base,
        anchor=frame[:, :3, 3],  # a joint of a URDF lies in its child's origin
        axis=np.array(axis).reshape(-1, 3),
        frame=frame,
        moves=chain_matrix(before),
        mass=mass,
        centre=centre,
        inertia=inertia,
        carried={what: one.mass for what, one in added.carried},
        shapes=places,
    )


def _placed(
    joints: list[ET.Element], values: Mapping[str, float], chosen: Mapping[str, int], base: Array
) -> _Links:
    children = {_end(joint, "child") for joint in joints}
    roots = {_end(joint, "parent") for joint in joints} - children
    pose, moved = dict.fromkeys(roots, base), dict.fromkeys(roots, -1)
    remaining = list(joints)
    while remaining:
        after = []
        for joint in remaining:
            carrier, link, name = _end(joint, "parent"), _end(joint, "child"), joint.get("name", "")
            if carrier not in pose:
                after.append(joint)
                continue
            pose[link] = pose[carrier] @ _origin(joint) @ _motion(joint, values.get(name, 0.0))
            moved[link] = chosen.get(name, moved[carrier])
        remaining = after
    return _Links(pose, moved)


def _motion(joint: ET.Element, value: float) -> Array:
    """(4, 4) transformation of a joint at that position; the unit matrix unless it is a hinge or a slide."""
    transform = np.eye(4)
    if joint.get("type") == "prismatic":
        transform[:3, 3] = _axis(joint) * value
    elif joint.get("type") in ("revolute", "continuous"):
        x, y, z = _axis(joint)
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        transform[:3, :3] += math.sin(value) * across + (1.0 - math.cos(value)) * across @ across
    return transform


def _axis(joint: ET.Element) -> Array:
    axis = _numbers(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
    return axis / np.linalg.norm(axis)


def _end(joint: ET.Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _origin(element: ET.Element) -> Array:
    origin = element.find("origin")
    return pose_matrix(_numbers(origin, "xyz", (0.0, 0.0, 0.0)), _numbers(origin, "rpy", (0.0, 0.0, 0.0)))


def pose_matrix(xyz: Array | tuple[float, ...], rpy: Array | tuple[float, ...]) -> Array:
    """(4, 4): roll about the fixed x, then pitch about y, then yaw about z."""
    transform = np.eye(4)
    for k, angle in enumerate(rpy):
        turn, (i, j) = np.eye(3), ((1, 2), (2, 0), (0, 1))[k]
        turn[i, i] = turn[j, j] = math.cos(angle)
        turn[j, i], turn[i, j] = math.sin(angle), -math.sin(angle)
        transform[:3, :3] = turn @ transform[:3, :3]
    transform[:3, 3] = xyz
    return transform


def _numbers(element: ET.Element | None, key: str, default: tuple[float, ...]) -> Array:
    text = None if element is None else element.get(key)
    return np.array(default if not text else [float(word) for word in text.split()])


def _at(xyz: tuple[float, float, float]) -> Array:
    return pose_matrix(xyz, (0.0, 0.0, 0.0))


def _carrier(one: Attached, joints: Mapping[str, ET.Element], links: _Links, chosen: tuple[str, ...]) -> str:
    """The link that carries a tool or payload: the named one, else what the last chosen joint moves."""
    if one.link:
        return one.link
    carrying = {links.joint[_end(joints[name], "parent")] for name in chosen}
    last = next(j for j in range(len(chosen)) if j not in carrying)
    return _end(joints[chosen[last]], "child")


def _parts(root: ET.Element, links: _Links) -> list[tuple[int, float, Array, Array]]:
    parts = []
    for link in root.findall("link"):
        inertial, name = link.find("inertial"), link.get("name", "")
        mass = 0.0 if inertial is None else float(_numbers(inertial.find("mass"), "value", (0.0,))[0])
        if inertial is None or mass < NO_MASS:
            continue
        element, moments = inertial.find("inertia"), np.zeros((3, 3))
        for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
            moments[i, j] = moments[j, i] = _numbers(element, f"i{'xyz'[i]}{'xyz'[j]}", (0.0,))[0]
        low, middle, high = np.linalg.eigvalsh(moments)
        if low < SMALLEST or high > low + middle:
            # an impossible inertia: `inertia` replaces it, and a note names the body
            moments = np.full((3, 3), np.nan)
        parts += _weighing(links, name, mass, _origin(inertial), moments)
    return parts


def _weighing(
    links: _Links, link: str, mass: float, place: Array, inertia: Array
) -> list[tuple[int, float, Array, Array]]:
    """A mass on a link, in the frame of the room; none for the base, which no joint moves."""
    joint = links.joint.get(link, -1)
    if joint < 0:
        return []
    pose = links.pose[link] @ place
    return [(joint, mass, pose[:3, 3], pose[:3, :3] @ inertia @ pose[:3, :3].T)]


def _places(link: ET.Element, links: _Links) -> tuple[Place, ...]:
    """The possible shapes of a link, collision and visual; primitive collision shapes are required."""
    places = []
    for shape in (*link.findall("collision"), *link.findall("visual")):
        geometry = shape.find("geometry")
        if geometry is not None and len(geometry):
            pose = links.pose.get(link.get("name", ""), np.eye(4)) @ _origin(shape)
            kind, needed = geometry[0].tag, shape.tag == "collision" and geometry[0].tag != "mesh"
            places.append(Place(kind, pose[:3, 3], pose[:3, :3], _size(geometry[0]), needed))
    return tuple(places)


def _size(shape: ET.Element) -> tuple[float, ...]:
    if shape.tag == "box":
        return tuple((0.5 * _numbers(shape, "size", ())).tolist())
    radius, length = (_numbers(shape, key, ()).tolist() for key in ("radius", "length"))
    return (*radius, *(0.5 * value for value in length)) if shape.tag != "mesh" else ()


def carried_place(one: Attached, carrier: Array) -> tuple[Place, ...]:
    """Shape of a tool or payload on a link at the pose `carrier` (4, 4); () if it has none."""
    if one.shape == "none":
        return ()
    pose = carrier @ pose_matrix(one.shape_centre or one.centre, one.rotation)
    half = tuple(0.5 * value for value in one.size)
    size = half if one.shape == "box" else (one.size[0], *half[1:])
    return (Place(one.shape, pose[:3, 3], pose[:3, :3], size, True),)
