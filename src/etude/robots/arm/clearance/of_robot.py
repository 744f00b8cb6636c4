"""The clearance of a robot as its file describes it, made once for each description."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.contracts import Array, Margins, Proof
from etude.robots.arm.clearance.gaps import Gaps
from etude.robots.arm.clearance.limit import Clearance
from etude.robots.arm.clearance.pairs import gaps_of
from etude.robots.arm.clearance.settled import ALWAYS, FEW, SEED, STILL, Settled, settled
from etude.robots.arm.clearance.skeleton import Skeleton
from etude.robots.arm.clearance.srdf import Pairs, disabled
from etude.robots.arm.clearance.surroundings import Floor, Surroundings
from etude.robots.arm.loading.load import load_arm
from etude.robots.arm.loading.loaded import Loaded
from etude.robots.arm.of_file import of_file
from etude.robots.arm.spec import ArmSpec

NO_FLOOR = "No floor is assumed at height 0 m, since {}: add [floor] with its height."
BELOW = 0.005
"""m: a base that reaches deeper below its own zero does not stand on a floor there."""
_known: dict[str, tuple[Loaded, Settled, dict[str, tuple[Proof, ...]]]] = {}


def clearance_of(spec: ArmSpec, margins: Margins) -> Clearance | None:
    """The limit; None for a robot without shapes, of which nothing can be looked at.

    Raises:
        UsageError: the model cannot be loaded, or the robot overlaps with itself or its surroundings at home.
    """
    found = _of(spec)
    if found is None or not found[1].gaps.list:
        return None
    loaded, complete, proofs = found
    home, lower, upper = search_of(spec)
    unseen = not_looked_at(loaded, complete.around)
    margin = complete.around.collision.margin
    # proofs without tracking margins are remembered beyond one limit: a command asks for its limits often
    known = {} if margins else proofs
    return Clearance(complete.gaps, spec.names, home, margin, lower, upper, margins, unseen, _proofs=known)


def search_of(spec: ArmSpec) -> tuple[Array, Array, Array]:
    """A clear pose and the ends (k,) of the box about it; without shapes the limits, and their middle."""
    search = spec.around.search
    if search is None or not search.lower:
        found = _of(spec)
        search = None if found is None or not found[1].gaps.list else found[1].around.search
    if search is None:
        return 0.5 * (spec.lower + spec.upper), spec.lower, spec.upper
    home, lower, upper = (np.array(side) for side in (search.home, search.lower, search.upper))
    return home, lower, upper


def completed(
    spec: ArmSpec, loaded: Loaded, leave: Pairs = frozenset(), *, assume_floor: bool
) -> tuple[Surroundings, tuple[str, ...]]:
    """The robot's surroundings with nothing left open, and what a person should confirm of them.

    Args:
        spec: of the robot. loaded: its model.
        leave: pairs of links that an SRDF disables.
        assume_floor: at height 0, if none is given and nothing of the base is below that.

    Raises:
        UsageError: as `settled`.
    """
    around, confirm = spec.around, []
    if not around.collision.look:
        return around, ()
    bare = gaps_of(loaded, spec.lower, spec.upper, Surroundings(floor=Floor(0.0)))
    if not bare.skeleton.shapes:
        return around, ()
    if assume_floor and around.floor is None:
        around, sentence = _on_a_floor(bare.skeleton, around)
        if around.floor is not None and (sunk := _sunk(bare)):
            around, sentence = spec.around, NO_FLOOR.format(f"{', '.join(sunk)} would always be in it")
        confirm.append(sentence)
    found = settled(loaded, spec.lower, spec.upper, around, leave)
    return found.around, (*confirm, *found.confirm)


def not_looked_at(loaded: Loaded, around: Surroundings) -> tuple[str, ...]:
    """Sentences: what the clearance of this robot leaves out."""
    ignored = [f"The distance of {one} and {other}." for one, other in around.collision.ignore]
    given = any((around.floor, around.box, around.wall, around.room, around.column))
    others = "Anything else that stands around the robot, cables, and people."
    unknown = (
        others if given else "What stands around the robot: no floor, box or wall is given. Cables, people."
    )
    return (*ignored, *(sentence[0].upper() + sentence[1:] + "." for sentence in loaded.unseen), unknown)


def _of(spec: ArmSpec) -> tuple[Loaded, Settled, dict[str, tuple[Proof, ...]]] | None:
    if spec.model_file is None or not spec.around.collision.look:
        return None
    file = spec.model_file

    def made() -> tuple[Loaded, Settled, dict[str, tuple[Proof, ...]]]:
        loaded = load_arm(spec)
        return loaded, settled(loaded, spec.lower, spec.upper, spec.around, disabled(file)), {}

    return of_file(_known, spec, made)


def _on_a_floor(skeleton: Skeleton, around: Surroundings) -> tuple[Surroundings, str]:
    """The surroundings with a floor, if the base can stand on one, and a sentence that says so."""
    lowest = _lowest(skeleton)
    if lowest < -BELOW:
        return around, NO_FLOOR.format(f"the base reaches {-lowest:.3g} m below it")
    sentence = "A floor is assumed at height 0 m, where the base stands: correct [floor], or take it out."
    return replace(around, floor=Floor(0.0)), sentence


def _sunk(bare: Gaps) -> list[str]:
    """Links that a floor at height 0 would hold in nearly every pose: the arm hangs, or stands on something.

    A foot that turns on the floor, and so keeps its distance, is none of them.

    Args:
        bare: the robot's, with that floor as its only wall.
    """
    distances = bare.to_walls(bare.skeleton.random_poses(np.random.default_rng(SEED), FEW))
    held = ((distances < -BELOW).mean(axis=0) > ALWAYS) & (np.ptp(distances, axis=0) > STILL)
    return list(
        dict.fromkeys(gap.names[0] for gap, is_held in zip(bare.walled, held, strict=True) if is_held)
    )


def _lowest(skeleton: Skeleton) -> float:
    """m, of the shapes that no joint moves; 0 if there are none."""
    import mujoco

    data = mujoco.MjData(skeleton.model)
    mujoco.mj_kinematics(skeleton.model, data)
    heights = [
        float(
            (shape.points @ data.geom_xmat[shape.geom].reshape(3, 3)[2]).min() + data.geom_xpos[shape.geom][2]
        )
        - shape.radius
        for shape in skeleton.shapes
        if shape.part == 0
    ]
    return min(heights, default=0.0)
