"""Check of the compiled model against the description (`expected`), whenever a robot is loaded.

A name that MuJoCo reserves, or an element that the writer omits, gives the model of another robot: without
its mounting on a wall, or without its payload. Motions designed and proved with that model are wrong, and no
other check detects it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UnsafeModelError
from etude.types import Array, Index
from etude_arm.loading.expected import Expected, Place

if TYPE_CHECKING:
    import mujoco

LENGTH = 1e-6
"""m: both evaluations use double precision, but MuJoCo computes the frame of a mesh in single precision."""
TURN = 1e-6
"""Tolerance of the entries of rotations and of unit vectors."""
SHARE = 1e-6
"""Relative tolerance of masses, moments of inertia and torques."""
NEGLIGIBLE = 1e-6
"""kg, kg m^2, N m and N: lighter frames are left out (`inertia.NO_MASS`)."""
SHOWN = 3
"""Largest number of differences in a message."""
HINGE, SLIDE, MESH = 3, 2, 7  # mjtJoint, mjtGeom
KINDS = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}  # mjtGeom
GUESSED = "capsule"
"""Shapes that replace a missing mesh: the description has no pose for them."""


def check_agreement(
    model: mujoco.MjModel, expected: Expected, where: str, *, shapes: bool, whole: bool = True
) -> None:
    """Compares the compiled model with the description at one pose.

    Args:
        model: the compiled model. expected: facts of the description. where: the file, for messages.
        shapes: whether the model must have shapes. whole: whether it must have all of them.

    Raises:
        UnsafeModelError: they differ; the message names the quantity, the difference and the joint or link.
    """
    differences = list(_joints(model, expected))
    if not differences:
        differences = _at_pose(model, expected, shapes, whole)
    refuse(differences, where)


def refuse(differences: list[str], where: str) -> None:
    """Raises an UnsafeModelError that names the first differences, if there are any."""
    if differences:
        more = f"; and {len(differences) - SHOWN} more" if len(differences) > SHOWN else ""
        raise UnsafeModelError(
            f"the compiled model differs from its description: {'; '.join(differences[:SHOWN])}{more}",
            where=where,
            next_step="Such a model is not used, because its forces and distances would be wrong. Please "
            "report it with the model file and robot.toml.",
        )


def _joints(model: mujoco.MjModel, expected: Expected) -> Iterator[str]:
    """Compares number, names and types of the joints."""
    names = [model.joint(j).name for j in range(model.njnt)]
    if sorted(names) != sorted(expected.joints):
        yield f"its joints are {', '.join(names) or 'none'}, to be {', '.join(expected.joints)}"
        return
    for name, slides in zip(expected.joints, expected.slides, strict=True):
        if int(model.jnt_type[model.joint(name).id]) != (SLIDE if slides else HINGE):
            yield f"joint '{name}' is to be a {'slide' if slides else 'hinge'}"


def _at_pose(model: mujoco.MjModel, expected: Expected, shapes: bool, whole: bool) -> list[str]:
    import mujoco

    data, joints = mujoco.MjData(model), np.array([model.joint(name).id for name in expected.joints])
    data.qpos[model.jnt_qposadr[joints]] = expected.q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    frame = np.tile(np.eye(4), (len(joints), 1, 1))
    bodies = model.jnt_bodyid[joints]
    frame[:, :3, :3], frame[:, :3, 3] = data.xmat[bodies].reshape(-1, 3, 3), data.xpos[bodies]
    differences = list(_base(model, frame, expected))
    if differences:  # with a wrong base every link below would differ, too
        return differences + list(_masses(model, data, joints, expected, placed=False))
    differences += _frames(frame, data.xanchor[joints], data.xaxis[joints], expected)
    differences += _masses(model, data, joints, expected, placed=True)
    differences += [] if differences else _weights(model, data, joints, expected)
    return differences + (list(_shapes(model, data, expected, whole)) if shapes else [])


def _base(model: mujoco.MjModel, frame: Array, expected: Expected) -> Iterator[str]:
    """Compares the pose of the base, from the joint next to it, and the direction of gravity."""
    first = int(np.flatnonzero(expected.moves.sum(axis=1) == 1)[0])
    base = frame[first] @ np.linalg.inv(expected.frame[first]) @ expected.base
    if not alike(base, expected.base):
        yield f"the base is {apart(base, expected.base)} where it should be"
    gravity, expected_gravity = base[:3, :3].T @ _gravity(model), expected.base[:3, :3].T @ expected.gravity
    if np.abs(gravity - expected_gravity).max() > TURN * max(float(np.linalg.norm(expected_gravity)), 1.0):
        yield f"gravity in the frame of the base is {_text(gravity)} m/s^2, to be {_text(expected_gravity)}"


def _gravity(model: mujoco.MjModel) -> Array:
    import mujoco

    off = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return np.zeros(3) if off else np.array(model.opt.gravity)


def _frames(frame: Array, anchor: Array, axis: Array, expected: Expected) -> Iterator[str]:
    for j, name in enumerate(expected.joints):
        if not alike(frame[j], expected.frame[j]):
            yield f"what joint '{name}' moves is {apart(frame[j], expected.frame[j])} where it should be"
        elif np.abs(axis[j] - expected.axis[j]).max() > TURN:
            yield f"the axis of joint '{name}' is {_text(axis[j])}, to be {_text(expected.axis[j])}"
        elif not expected.slides[j] and _off_axis(anchor[j] - expected.anchor[j], axis[j]) > LENGTH:
            yield f"joint '{name}' turns about {_text(anchor[j])} m, to be {_text(expected.anchor[j])}"


def _off_axis(away: Array, axis: Array) -> float:
    return float(np.linalg.norm(away - axis * (axis @ away)))


def _parts(model: mujoco.MjModel, joints: Index) -> Array:
    """(B,) for each body the index of the last joint that moves it; -1 for bodies fixed to the world."""
    place = {int(j): k for k, j in enumerate(joints)}
    part = np.full(model.nbody, -1)
    for b in range(1, model.nbody):
        first, count = int(model.body_jntadr[b]), int(model.body_jntnum[b])
        part[b] = place[first + count - 1] if count else part[model.body_parentid[b]]
    return part


def _masses(
    model: mujoco.MjModel, data: mujoco.MjData, joints: Index, expected: Expected, *, placed: bool
) -> Iterator[str]:
    """Compares the mass of the rigid part that each joint moves; if `placed`, also its centre and inertia."""
    part = _parts(model, joints)
    for j, name in enumerate(expected.joints):
        mask = part == j
        mass, expected_mass = float(model.body_mass[mask].sum()), float(expected.mass[j])
        if abs(mass - expected_mass) > NEGLIGIBLE + SHARE * expected_mass:
            why = _missing_load(expected_mass - mass, expected)
            yield f"what joint '{name}' moves weighs {mass:.6g} kg, to be {expected_mass:.6g}{why}"
            continue
        if not placed or expected_mass <= NEGLIGIBLE:
            continue
        weights = model.body_mass[mask]
        centre = weights @ data.xipos[mask] / mass
        if np.abs(centre - expected.centre[j]).max() > LENGTH * max(1.0, NEGLIGIBLE * 1e3 / expected_mass):
            away = float(np.linalg.norm(centre - expected.centre[j]))
            yield f"the centre of mass of what joint '{name}' moves is off by {away:.3g} m"
            continue
        inertia = _inertia(model, data, np.flatnonzero(mask), centre)
        off = float(np.abs(inertia - expected.inertia[j]).max())  # NaN: no possible inertia
        # a negligible mass at 0.1 m
        if off > NEGLIGIBLE * 1e-2 + SHARE * float(np.trace(expected.inertia[j])):
            yield f"the inertia of what joint '{name}' moves is off by {off:.3g} kg m^2"


def _inertia(model: mujoco.MjModel, data: mujoco.MjData, bodies: Index, centre: Array) -> Array:
    inertia = np.zeros((3, 3))
    for b in bodies:
        turn, away = data.ximat[b].reshape(3, 3), data.xipos[b] - centre
        inertia += turn * model.body_inertia[b] @ turn.T
        inertia += model.body_mass[b] * (away @ away * np.eye(3) - np.outer(away, away))
    return inertia


def _missing_load(less: float, expected: Expected) -> str:
    """Names of the tool or payload whose mass equals the missing mass."""
    for what, mass in expected.carried.items():
        # masses in files have three digits or more
        if abs(less - mass) < NEGLIGIBLE + 1e-3 * mass:
            return f": the {what} ({mass:g} kg) is not there"
    return ""


def _weights(model: mujoco.MjModel, data: mujoco.MjData, joints: Index, expected: Expected) -> Iterator[str]:
    """Compares torques of gravity: from MuJoCo's recursion, and from masses and lever arms."""
    import mujoco

    held = np.zeros(model.nv)
    mujoco.mj_rne(model, data, 0, held)
    yield from weight_differences(held[model.jnt_dofadr[joints]], expected)


def weight_differences(torque: Array, expected: Expected) -> Iterator[str]:
    """A sentence for each torque of gravity (J,) that differs from the expected one."""
    expected_torque = expected.weight
    # total weight, N, at 1 m: sums of torques that cancel have rounding errors of this size
    scale = float(np.abs(expected_torque).max(initial=0.0)) + 9.81 * float(expected.mass.sum())
    for j, name in enumerate(expected.joints):
        if abs(torque[j] - expected_torque[j]) > NEGLIGIBLE + SHARE * scale:
            unit = "N" if expected.slides[j] else "N m"
            yield f"gravity asks {torque[j]:.6g} {unit} of joint '{name}', to be {expected_torque[j]:.6g}"


def _shapes(model: mujoco.MjModel, data: mujoco.MjData, expected: Expected, whole: bool) -> Iterator[str]:
    """Checks that every shape, called "link#k", has a pose of its link's shapes, and that no required shape
    is missing.
    """
    unmatched: dict[str, list[Place]] = {link: list(places) for link, places in expected.shapes.items()}
    matched: set[int] = set()
    for g in range(model.ngeom):
        link, numbered, _ = str(model.geom(g).name).rpartition("#")
        if not numbered or link not in unmatched:
            continue
        geom = _place(model, data, g)
        same = [place for place in unmatched[link] if _alike(place, geom)]
        if same:
            best = min(same, key=lambda place: not place.needed)
            if geom.kind == "mesh":  # a bent mesh has several hulls at one pose
                matched.add(id(best))
            else:
                unmatched[link].remove(best)
        elif geom.kind != GUESSED or all(place.kind != "mesh" for place in expected.shapes[link]):
            centre = _text(geom.centre)
            yield f"a {geom.kind} of '{link}' stands at {centre} m, where the description has none"
    if whole:
        for link, places in unmatched.items():
            missing = [place for place in places if place.needed and id(place) not in matched]
            if missing:
                yield f"a {missing[0].kind} of '{link}' is missing, at {_text(missing[0].centre)} m"


def _place(model: mujoco.MjModel, data: mujoco.MjData, g: int) -> Place:
    """Pose of a geom. Of a mesh: in the frame of its file, which MuJoCo rotates to the principal axes of the
    mesh.
    """
    import mujoco

    kind, turn, centre = int(model.geom_type[g]), data.geom_xmat[g].reshape(3, 3), data.geom_xpos[g]
    if kind == MESH:
        mesh, rotation = int(model.geom_dataid[g]), np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.mesh_quat[mesh])
        turn = turn @ rotation.reshape(3, 3).T
        centre = centre - turn @ model.mesh_pos[mesh]
    return Place(KINDS.get(kind, ""), centre, turn, tuple(model.geom_size[g].tolist()))


def _alike(place: Place, geom: Place) -> bool:
    """Whether a geom equals the shape; the rotation of a sphere does not matter."""
    size = np.array(geom.size[: len(place.size)]) - place.size
    return (
        place.kind == geom.kind
        and float(np.abs(place.centre - geom.centre).max())
        < LENGTH * max(1.0, float(np.abs(geom.centre).max()))
        and (place.kind == "sphere" or float(np.abs(place.turn - geom.turn).max()) < TURN)
        and float(np.abs(size).max(initial=0.0)) < LENGTH
    )


def alike(one: Array, other: Array) -> bool:
    """Whether two poses (4, 4) are equal within the tolerances."""
    far = max(1.0, float(np.abs(other[:3, 3]).max()))
    turned = float(np.abs(one[:3, :3] - other[:3, :3]).max())
    return turned < TURN and float(np.abs(one[:3, 3] - other[:3, 3]).max()) < LENGTH * far


def apart(one: Array, other: Array) -> str:
    away = float(np.linalg.norm(one[:3, 3] - other[:3, 3]))
    turn = float(np.clip(0.5 * (np.trace(one[:3, :3].T @ other[:3, :3]) - 1.0), -1.0, 1.0))
    return f"{away:.4g} m and {np.degrees(np.arccos(turn)):.4g} deg away from"


def _text(values: Array) -> str:
    return ", ".join(f"{value + 0.0:.4g}" for value in values)
