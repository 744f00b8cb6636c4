"""What an MJCF has beside its tree of bodies: loops, locks, tendons, and a gravity of its own.

A loop that the chosen joints move against is refused, since an open chain would tear it apart. The rest is
said: gravity that the file switches off, springs and stops of tendons.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude_arm.loading.choice import Choice
from etude_arm.loading.mjcf_drives import ON_JOINT, ON_TENDON, WRAP_JOINT, WRAP_SITE
from etude_arm.loading.mjcf_joints import FREE
from etude_arm.loading.mjcf_parts import joints_of, name_of, part_of

if TYPE_CHECKING:
    import mujoco

CONNECT, WELD, JOINT, TENDON = 0, 1, 2, 3  # mjtEq
SITE = 6  # mjtObj
NO_GRAVITY = 1 << 7  # mjtDisableBit.mjDSBL_GRAVITY
DOWN = np.array([0.0, 0.0, -9.81])
CLOSE = 0.1
"""m/s^2 by which the earth's gravity differs from place to place, and a little more."""


def check_loops(model: mujoco.MjModel, choice: Choice, where: str) -> None:
    """Raises a UsageError if an equality holds parts together that the chosen joints move, or locks one."""
    for k in np.flatnonzero(model.eq_active0):
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        if model.eq_type[k] in (CONNECT, WELD):
            of_sites = model.eq_objtype[k] == SITE
            one, other = (int(model.site_bodyid[e]) if of_sites else e for e in (first, second))
            if part_of(model, choice, one) != part_of(model, choice, other) and not _led(model, (one, other)):
                raise UsageError(
                    f"the file closes a loop: '{name_of(model, one)}' and '{name_of(model, other)}' are held "
                    "together, and joints that should move lie between them",
                    where=where,
                    next_step="Only open chains have an inverse dynamics here: choose joints outside the "
                    f"loop{_outside(model, choice, (one, other))}, or take the equality out of a copy of the "
                    "file if the robot has none.",
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
    found: set[str] = set()
    while b:
        found |= {model.joint(j).name for j in joints_of(model, b)}
        b = int(model.body_parentid[b])
    return found


def _zero(model: mujoco.MjModel, joint: int) -> float:
    return float(model.qpos0[model.jnt_qposadr[joint]])


def _led(model: mujoco.MjModel, bodies: tuple[int, int]) -> bool:
    """Whether one of them is what a simulation leads the robot by (mocap), or an object that lies free."""
    roots = [int(model.body_rootid[b]) for b in bodies]
    free = any(model.jnt_type[j] == FREE for root in roots for j in joints_of(model, root))
    return any(model.body_mocapid[b] >= 0 for b in bodies) or (free and roots[0] != roots[1])


def notes_of(model: mujoco.MjModel, choice: Choice) -> tuple[str, ...]:
    """What a person should know before torques of this file are believed."""
    off = bool(model.opt.disableflags & NO_GRAVITY) or not model.opt.gravity.any()
    notes = []
    if off:
        notes.append(
            "The file switches gravity off: torques here have none. Correct its <option> unless that is so."
        )
    elif np.abs(model.opt.gravity - DOWN).max() > CLOSE:
        pull = ", ".join(f"{x:g}" for x in model.opt.gravity)
        notes.append(f"Gravity in the file is ({pull}) m/s^2, not 9.81 downwards along z: is that so?")
    light = [name_of(model, b) for b in range(1, model.nbody) if model.body_gravcomp[b] and not off]
    moved = [name for name in light if part_of(model, choice, model.body(name).id)] if light else []
    if moved:
        notes.append(
            f"The file takes the weight off {', '.join(moved)} (gravcomp): right only if something beside "
            "the joints' drives carries them."
        )
    if idle := _idle(model, choice):
        notes.append(
            f"No actuator of the file drives {', '.join(idle)}: leave out with --joints what moves by itself."
        )
    springs = [name for name, t in _tendons(model, choice) if np.ravel(model.tendon_stiffness[t])[0] > 0.0]
    if springs:
        notes.append(f"The springs of tendons are left out: {', '.join(springs)}.")
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


def unseen_of(model: mujoco.MjModel, choice: Choice) -> tuple[str, ...]:
    """What a certificate does not look at: stops over several joints, and ties between them."""
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
