"""MJCF loading: MuJoCo compiles the file, which is then rewritten with only the chosen joints.

A closed loop that contains chosen joints is refused, since the model is an open chain. Notes name other
losses: gravity that the file switches off, springs and stops of tendons.

MuJoCo defines the meaning of an MJCF: default classes, includes, attached models, masses from shapes, orders
of Euler angles. A second parser would have more errors than it would detect. So the second evaluation
(`mjcf_expected`) uses MuJoCo's model of the whole file, with held joints at their positions. The mounting
multiplies its poses, and tool and payload are added to its bodies.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.clearance.surroundings import Wall
from etude_arm.loading.attachments import Additions, Attached, Mounting
from etude_arm.loading.expected import (
    Expected,
    Place,
    carried_place,
    chain_matrix,
    gathered,
    pose_matrix,
    pose_of_joints,
)
from etude_arm.loading.joint_choice import Choice, choose, example
from etude_arm.loading.loaded_model import Loaded
from etude_arm.loading.mjcf_compiled import (
    BALL,
    FREE,
    HINGE,
    PLANE,
    SHAPES,
    SLIDE,
    compiled,
    joints_of,
    moving,
    name_of,
    numbered,
    part_of,
)
from etude_arm.loading.mjcf_writer import ON_JOINT, ON_TENDON, WRAP_JOINT, WRAP_SITE, written
from etude_arm.loading.parsing import free_name

if TYPE_CHECKING:
    import mujoco


DIGITS = 6
"""Tolerance of positions, m, and of directions."""


def planes_of(model: mujoco.MjModel) -> tuple[Wall, ...]:
    """The planes of fixed bodies, in the frame of the file, named after their geoms."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    planes: list[Wall] = []
    for g in range(model.ngeom):
        if int(model.geom_type[g]) == PLANE and not model.body_weldid[model.geom_bodyid[g]]:
            name = numbered(model.geom(g).name or "plane", [wall.name for wall in planes], " ")
            # people read them: -0.0 becomes 0.0
            at, normal = (v.round(DIGITS) + 0.0 for v in (data.geom_xpos[g], data.geom_xmat[g][2::3]))
            planes.append(Wall(name, tuple(at.tolist()), tuple(normal.tolist())))
    return tuple(planes)


def beside(model: mujoco.MjModel, choice: Choice, shapes: Mapping[str, int]) -> dict[str, str]:
    """Shape -> name, for bodies of the world beside the robot.

    Args:
        model: of the file. choice: of joints.
        shapes: geoms of the model by the names that they were given, "body#k".
    """
    roots = {int(model.body_rootid[model.jnt_bodyid[model.joint(name).id]]) for name in choice.joints}
    names: dict[str, str] = {}
    for shape, g in shapes.items():
        b = int(model.geom_bodyid[g])
        if int(model.body_rootid[b]) not in roots:
            geom_name = model.geom(g).name or (name_of(model, b) if b else "box")
            # a name with # would be one of a link's shapes
            names[shape] = numbered(geom_name.replace("#", " "), names.values(), " ")
    return names


CONNECT, WELD, JOINT, TENDON = 0, 1, 2, 3  # mjtEq
SITE = 6  # mjtObj
NO_GRAVITY = 1 << 7  # mjtDisableBit.mjDSBL_GRAVITY
DOWN = np.array([0.0, 0.0, -9.81])
CLOSE = 0.1
"""m/s^2: variation of gravity over the earth, with a margin."""


def check_loops(model: mujoco.MjModel, choice: Choice, where: str) -> None:
    """Raises a UsageError if an equality constrains parts that the chosen joints move, or locks a joint."""
    for k in np.flatnonzero(model.eq_active0):
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        if model.eq_type[k] in (CONNECT, WELD):
            of_sites = model.eq_objtype[k] == SITE
            one, other = (int(model.site_bodyid[e]) if of_sites else e for e in (first, second))
            if part_of(model, choice, one) != part_of(model, choice, other) and not _led(model, (one, other)):
                raise UsageError(
                    f"the file closes a loop: '{name_of(model, one)}' and '{name_of(model, other)}' are "
                    "connected, with moving joints between them",
                    where=where,
                    next_step="Only open chains have an inverse dynamics here: choose joints outside the "
                    f"loop{_outside(model, choice, (one, other))}, or remove the equality from a copy "
                    "of the file if the robot has none.",
                )
        elif model.eq_type[k] == JOINT and second < 0 and model.joint(first).name in choice.joints:
            name, at = model.joint(first).name, float(model.eq_data[k, 0]) + _zero(model, first)
            raise UsageError(
                f"the file locks joint '{name}' (an equality with no other joint)",
                where=where,
                next_step=f"Choose the others with --joints, and --hold {name}={at:g}; or take the equality "
                "out of a copy of the file.",
            )


def _outside(model: mujoco.MjModel, choice: Choice, bodies: tuple[int, int]) -> str:
    """The option that keeps the chosen joints before a loop, which carry both of its ends."""
    carrying = [_carriers(model, b) for b in bodies]
    before = [name for name in choice.joints if all(name in names for names in carrying)]
    return f" with --joints, for example --joints {shlex.join(before)}" if before else " with --joints"


def _carriers(model: mujoco.MjModel, b: int) -> set[str]:
    """Names of the joints between the world and a body."""
    joints: set[str] = set()
    while b:
        joints |= {model.joint(j).name for j in joints_of(model, b)}
        b = int(model.body_parentid[b])
    return joints


def _zero(model: mujoco.MjModel, joint: int) -> float:
    return float(model.qpos0[model.jnt_qposadr[joint]])


def _led(model: mujoco.MjModel, bodies: tuple[int, int]) -> bool:
    """Whether one of the bodies is a mocap body, which guides a simulation, or a free object."""
    roots = [int(model.body_rootid[b]) for b in bodies]
    free = any(model.jnt_type[j] == FREE for root in roots for j in joints_of(model, root))
    return any(model.body_mocapid[b] >= 0 for b in bodies) or (free and roots[0] != roots[1])


def notes_of(model: mujoco.MjModel, choice: Choice) -> tuple[str, ...]:
    """Notes for the user on torques of this file."""
    off = bool(model.opt.disableflags & NO_GRAVITY) or not model.opt.gravity.any()
    notes = []
    if off:
        notes.append(
            "The file disables gravity, so torques here have none. Correct its <option> unless this is right."
        )
    elif np.abs(model.opt.gravity - DOWN).max() > CLOSE:
        gravity = ", ".join(f"{x:g}" for x in model.opt.gravity)
        notes.append(f"Gravity in the file is ({gravity}) m/s^2, not 9.81 downwards along z: check this.")
    light = [name_of(model, b) for b in range(1, model.nbody) if model.body_gravcomp[b] and not off]
    moved = [name for name in light if part_of(model, choice, model.body(name).id)] if light else []
    if moved:
        notes.append(
            f"The file compensates the weight of {', '.join(moved)} (gravcomp): right only if something "
            "other than the joints' drives carries them."
        )
    if idle := _idle(model, choice):
        notes.append(
            f"No actuator of the file drives {', '.join(idle)}: exclude joints without a drive with --joints."
        )
    springs = [name for name, t in _tendons(model, choice) if np.ravel(model.tendon_stiffness[t])[0] > 0.0]
    if springs:
        notes.append(f"The springs of tendons are ignored: {', '.join(springs)}.")
    sprung = [name for name in choice.joints if np.ravel(model.joint(name).stiffness)[0] > 0.0]
    if sprung:
        notes.append(
            f"The file's springs of {', '.join(sprung)} are no part of its torques here: only logs show them."
        )
    return tuple(notes)


def _idle(model: mujoco.MjModel, choice: Choice) -> list[str]:
    """The chosen joints without an actuator, where others have one: a base that slides, a pendulum."""
    driven: set[str] = set()
    for kind, (target, *_) in zip(model.actuator_trntype, model.actuator_trnid, strict=True):
        if kind in ON_JOINT:
            driven.add(model.joint(int(target)).name)
        elif kind == ON_TENDON:
            driven |= _pulled(model, int(target))
    idle = [name for name in choice.joints if name not in driven]
    return idle if len(idle) < len(choice.joints) else []


def unverified_of(model: mujoco.MjModel, choice: Choice) -> tuple[str, ...]:
    """Sentences on what a certificate does not verify: stops over several joints, and couplings between
    them.
    """
    tied = {int(end) for k in np.flatnonzero(model.eq_active0) if model.eq_type[k] == TENDON for end in
            (model.eq_obj1id[k], model.eq_obj2id[k])}  # fmt: skip
    held = [name for name, t in _tendons(model, choice) if model.tendon_limited[t] or t in tied]
    return (f"the limits of tendons over several joints: {', '.join(held)}",) if held else ()


def _pulled(model: mujoco.MjModel, t: int) -> set[str]:
    """Names of the joints that a tendon runs over; of one through space all, since any may be."""
    first = int(model.tendon_adr[t])
    wraps = range(first, first + int(model.tendon_num[t]))
    if any(model.wrap_type[w] != WRAP_JOINT for w in wraps):
        return {model.joint(j).name for j in range(model.njnt)}
    return {model.joint(int(model.wrap_objid[w])).name for w in wraps}


def _tendons(model: mujoco.MjModel, choice: Choice) -> Iterator[tuple[str, int]]:
    """Names and numbers of the tendons that the chosen joints stretch."""
    for t in range(model.ntendon):
        first = int(model.tendon_adr[t])
        wraps = range(first, first + int(model.tendon_num[t]))
        joints = {
            model.joint(int(model.wrap_objid[w])).name for w in wraps if model.wrap_type[w] == WRAP_JOINT
        }
        sites = [int(model.wrap_objid[w]) for w in wraps if model.wrap_type[w] == WRAP_SITE]
        parts = {part_of(model, choice, int(model.site_bodyid[site])) for site in sites}
        if joints & set(choice.joints) or len(parts) > 1:
            yield model.tendon(t).name or f"tendon {t}", t


def load_mjcf(
    path: Path, patterns: Sequence[str] | None, positions: Mapping[str, float], drives: bool, added: Additions
) -> Loaded:
    """`load.load` of an MJCF."""
    compilation = compiled(path)
    model = compilation.model
    choice = chosen_in(model, patterns, positions, str(path))
    new = written(model, choice, drives, added)
    exception = "".join(f" although '{name}' leaves it free" for name in _floating(model))
    lost = [f"the shape of {what}: its mesh is missing" for what in compilation.shapeless]
    bodies = [body for _, body in _lying(model)]
    stays = [f"'{body}' is free and assumed to stay at its position in the file" for body in bodies]
    base = f"the base is assumed to be fixed{exception}"
    unverified = (
        base,
        *stays,
        *choice.unverified,
        *lost,
        *unverified_of(model, choice),
        *new.unverified,
        *added.unverified(),
    )
    lying = [f"Free bodies are assumed to stay at their positions in the file: {', '.join(bodies)}."]
    notes = (
        *choice.notes,
        *(lying if bodies else ()),
        *compilation.notes,
        *notes_of(model, choice),
        *new.notes,
    )
    room = {"planes": planes_of(model), "beside": beside(model, choice, new.shapes)}
    head = (new.xml, new.assets, choice.joints, choice.held, notes, unverified, new.excluded)
    expected = mjcf_expected(model, choice, added)
    return Loaded(*head, **room, source=str(path), added=new.added, expected=expected)  # type: ignore[arg-type]


def chosen_in(
    model: mujoco.MjModel, patterns: Sequence[str] | None, positions: Mapping[str, float], where: str
) -> Choice:
    """The choice of joints in an MJCF; a floating base is fixed only if the user names joints.

    Raises:
        UsageError: as `joint_choice.choose`; a floating base, or a closed loop.
    """
    floating = _floating(model)
    if floating and patterns is None:
        ball = model.jnt_type[model.joint(floating[0]).id] == BALL
        what = "is a ball joint" if ball else "is free"
        raise UsageError(
            f"{'' if ball else 'the base is not fixed: '}joint '{floating[0]}' {what}",
            where=where,
            next_step="Only hinge and slide joints on a fixed base have an inverse dynamics here. "
            f"{'If it can be fixed' if ball else 'If the base does not move'}, choose the arm with "
            "--joints, of "
            f"{', '.join(joint.name for joint in moving(model)) or 'none'}{example(moving(model))}.",
        )
    choice = choose(moving(model), patterns, positions, where)
    check_loops(model, choice, where)
    return choice


def _floating(model: mujoco.MjModel) -> list[str]:
    """Names of ball joints, and of free joints of bodies that carry a hinge or a slide."""
    lying = {joint for joint, _ in _lying(model)}
    names = [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] not in (HINGE, SLIDE)]
    return [name for name in names if name not in lying]


def _lying(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Free joints and bodies of objects beside the robot, which have no other joints."""
    carried = [int(model.body_rootid[body]) for body in model.jnt_bodyid]
    return [
        (model.joint(j).name, name_of(model, int(model.jnt_bodyid[j])))
        for j in range(model.njnt)
        if model.jnt_type[j] == FREE and carried.count(int(model.jnt_bodyid[j])) == 1
    ]


SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3, "mesh": 0}


def mjcf_expected(model: mujoco.MjModel, choice: Choice, added: Additions) -> Expected:
    """The facts of the model of a whole MJCF, with its chosen joints and additions."""
    import mujoco

    joints = [model.joint(name).id for name in choice.joints]
    slides = np.array([int(model.jnt_type[j]) == SLIDE for j in joints])
    q, data = pose_of_joints(slides), mujoco.MjData(model)
    for name, value in (*choice.held.items(), *zip(choice.joints, q.tolist(), strict=True)):
        data.qpos[model.jnt_qposadr[model.joint(name).id]] = value
    mujoco.mj_kinematics(model, data)
    mounting = added.mounting or Mounting()
    base = pose_matrix(mounting.position, mounting.rotation)
    pose = [base @ _matrix(*of) for of in zip(data.xpos, data.xmat, strict=True)]
    moved, before = _moved(model, joints)
    parts = []
    for b in np.flatnonzero((np.array(moved) >= 0) & (model.body_mass > 0.0)).tolist():
        frame = base @ _matrix(data.xipos[b], data.ximat[b])
        inertia = frame[:3, :3] * model.body_inertia[b] @ frame[:3, :3].T
        parts.append((moved[b], float(model.body_mass[b]), frame[:3, 3], inertia))
    places = _places(model, data, base)
    taken = [name_of(model, b) for b in range(model.nbody)]
    for what, one in added.carried:
        b = taken.index(one.link) if one.link else _tip(model, joints, before)
        frame = pose[b] @ pose_matrix(one.centre, (0.0, 0.0, 0.0))
        parts += _weighing(moved[b], one, frame)
        places[free_name(what, taken)] = carried_place(one, pose[b])
    mass, centre, inertia = gathered(parts, len(q))
    gravity = np.zeros(3) if model.opt.disableflags & NO_GRAVITY else np.array(model.opt.gravity)
    return Expected(
        q=q,
        joints=choice.joints,
        slides=slides,
        gravity=gravity,
        base=base,
        anchor=data.xanchor[joints] @ base[:3, :3].T + base[:3, 3],
        axis=data.xaxis[joints] @ base[:3, :3].T,
        frame=np.array([pose[int(model.jnt_bodyid[j])] for j in joints]),
        moves=chain_matrix(np.array(before)),
        mass=mass,
        centre=centre,
        inertia=inertia,
        carried={what: one.mass for what, one in added.carried},
        shapes=places,
    )


def _matrix(place: Array, turn: Array) -> Array:
    transform = np.eye(4)
    transform[:3, 3], transform[:3, :3] = place, turn.reshape(3, 3)
    return transform


def _moved(model: mujoco.MjModel, joints: list[int]) -> tuple[list[int], list[int]]:
    """For each body the index of the last chosen joint that moves it; for each chosen joint that of its
    parent; or -1.
    """
    moved, before = [-1] * model.nbody, [-1] * len(joints)
    for b in range(1, model.nbody):
        last = moved[int(model.body_parentid[b])]
        first = int(model.body_jntadr[b])
        for j in range(first, first + int(model.body_jntnum[b])):
            if j in joints:
                before[joints.index(j)], last = last, joints.index(j)
        moved[b] = last
    return moved, before


def _tip(model: mujoco.MjModel, joints: list[int], before: list[int]) -> int:
    """The body of the chosen joint that carries no other."""
    last = next(j for i, j in enumerate(joints) if i not in before)
    return int(model.jnt_bodyid[last])


def _weighing(joint: int, one: Attached, place: Array) -> list[tuple[int, float, Array, Array]]:
    if joint < 0:
        return []
    inertia = place[:3, :3] @ one.moments() @ place[:3, :3].T
    return [(joint, one.mass, place[:3, 3], inertia)]


def _places(model: mujoco.MjModel, data: mujoco.MjData, base: Array) -> dict[str, tuple[Place, ...]]:
    """The possible shapes of all bodies; collision shapes are required."""
    places: dict[str, tuple[Place, ...]] = {}
    for g in range(model.ngeom):
        kind = SHAPES.get(int(model.geom_type[g]))
        if kind is not None:
            pose = base @ _matrix(data.geom_xpos[g], data.geom_xmat[g])
            size = tuple(model.geom_size[g][: SIZES[kind]].tolist())
            needed = bool(model.geom_contype[g] or model.geom_conaffinity[g])
            name = name_of(model, int(model.geom_bodyid[g]))
            places[name] = (*places.get(name, ()), Place(kind, pose[:3, 3], pose[:3, :3], size, needed))
    return places
