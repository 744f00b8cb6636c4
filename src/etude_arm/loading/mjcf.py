"""An MJCF, compiled by MuJoCo as it is and written anew with the chosen joints alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from etude.errors import UsageError
from etude_arm.loading.attached import Additions
from etude_arm.loading.choice import Choice, choose
from etude_arm.loading.limbs import example
from etude_arm.loading.loaded import Loaded
from etude_arm.loading.mjcf_beside import beside, planes_of
from etude_arm.loading.mjcf_compiled import compiled
from etude_arm.loading.mjcf_couplings import check_loops, notes_of, unseen_of
from etude_arm.loading.mjcf_expected import mjcf_expected
from etude_arm.loading.mjcf_joints import BALL, FREE, HINGE, SLIDE, moving
from etude_arm.loading.mjcf_parts import name_of
from etude_arm.loading.mjcf_writer import written

if TYPE_CHECKING:
    import mujoco


def load_mjcf(
    path: Path, wanted: Sequence[str] | None, given: Mapping[str, float], drives: bool, added: Additions
) -> Loaded:
    """`load.load` of an MJCF."""
    found = compiled(path)
    model = found.model
    choice = chosen_in(model, wanted, given, str(path))
    new = written(model, choice, drives, added)
    loose = "".join(f" although '{name}' leaves it free" for name in _floating(model))
    lost = [f"the shape of {what}: its mesh is missing" for what in found.shapeless]
    bodies = [body for _, body in _lying(model)]
    stays = [f"'{body}' lies free and is taken to stay where the file puts it" for body in bodies]
    base = f"the base is taken to be fixed{loose}"
    unseen = (base, *stays, *choice.unseen, *lost, *unseen_of(model, choice), *new.unseen, *added.unseen())
    lying = [f"Bodies that lie free are taken to stay where the file puts them: {', '.join(bodies)}."]
    notes = (*choice.notes, *(lying if bodies else ()), *found.notes, *notes_of(model, choice), *new.notes)
    room = {"planes": planes_of(model), "beside": beside(model, choice, new.shapes)}
    head = (new.xml, new.assets, choice.joints, choice.held, notes, unseen, new.excluded)
    expected = mjcf_expected(model, choice, added)
    return Loaded(*head, **room, source=str(path), added=new.added, expected=expected)  # type: ignore[arg-type]


def chosen_in(
    model: mujoco.MjModel, wanted: Sequence[str] | None, given: Mapping[str, float], where: str
) -> Choice:
    """The choice of joints in an MJCF; a base that the file leaves free is fixed only if joints are named.

    Raises:
        UsageError: as `choice.choose`; a base that is free, or a loop that is closed.
    """
    floating = _floating(model)
    if floating and wanted is None:
        ball = model.jnt_type[model.joint(floating[0]).id] == BALL
        what = "is a ball joint" if ball else "is free"
        raise UsageError(
            f"{'' if ball else 'the base is not fixed: '}joint '{floating[0]}' {what}",
            where=where,
            next_step="Only hinge and slide joints on a fixed base have an inverse dynamics here. "
            f"{'If it can be held' if ball else 'If the base stands still'}, choose the arm with --joints, "
            f"of {', '.join(joint.name for joint in moving(model)) or 'none'}{example(moving(model))}.",
        )
    choice = choose(moving(model), wanted, given, where)
    check_loops(model, choice, where)
    return choice


def _floating(model: mujoco.MjModel) -> list[str]:
    """Names of ball joints, and of those that leave free what carries a hinge or a slide."""
    lying = {joint for joint, _ in _lying(model)}
    loose = [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] not in (HINGE, SLIDE)]
    return [name for name in loose if name not in lying]


def _lying(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Free joints and bodies of what a scene holds beside the robot: objects without joints of their own."""
    carried = [int(model.body_rootid[body]) for body in model.jnt_bodyid]
    return [
        (model.joint(j).name, name_of(model, int(model.jnt_bodyid[j])))
        for j in range(model.njnt)
        if model.jnt_type[j] == FREE and carried.count(int(model.jnt_bodyid[j])) == 1
    ]
