"""Clearance limit of a robot from its file, computed once for each description.

Reachable poses are random clear poses with a straight clear line to home. No proof relies on them: each
motion about them is proved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from etude.abilities import SupportsBoxes
from etude.limits.robot_file_limits import made_limits
from etude.types import Array, Margins, Mask, Proof, Reachable
from etude_arm.clearance.clearance_limit import Clearance
from etude_arm.clearance.collision_scene import from_file, with_floor
from etude_arm.clearance.defaults import ClearanceDefaults, Pairs, disabled, settled
from etude_arm.clearance.distances import TOLERANCE
from etude_arm.clearance.hull_reduction import hull_sentences
from etude_arm.clearance.pairs import excluded_links, gaps_of
from etude_arm.clearance.skeleton import Skeleton, skeleton_of
from etude_arm.clearance.surroundings import ADD_FLOOR, Surroundings
from etude_arm.command_limits import weight_on_drives
from etude_arm.loading.load import load_arm, of_file
from etude_arm.loading.loaded_model import Loaded
from etude_arm.spec import ArmSpec

PLANE = f"A plane of the model file is ignored{ADD_FLOOR}"
_cached_reachable: dict[str, Reachable] = {}
_cached_clearances: dict[str, tuple[Loaded, ClearanceDefaults, dict[str, tuple[Proof, ...]]]] = {}


def clearance_of(spec: ArmSpec, margins: Margins) -> Clearance | None:
    """The limit; None for a robot without shapes.

    Raises:
        UsageError: the model cannot be loaded, or at home the robot overlaps itself or its surroundings.
    """
    prepared = _of(spec)
    if prepared is None or not prepared[1].gaps.list:
        return None
    loaded, complete, proofs = prepared
    home, lower, upper = search_of(spec)
    skeleton = complete.gaps.skeleton
    out = [
        f"The distance of {a} and {b}, which the file excludes." for a, b in excluded_links(skeleton, loaded)
    ]
    unverified = (
        *out,
        *beside_base(skeleton),
        *hull_sentences(skeleton),
        *not_verified(loaded, complete.around),
    )
    margin = complete.around.collision.margin
    # proofs without tracking margins are cached beyond one limit: a command makes its limits often
    cache = {} if margins else proofs
    return Clearance(
        complete.gaps, spec.names, home, margin, lower, upper, margins, unverified, _proofs=cache
    )


def skeleton_of_robot(spec: ArmSpec) -> Skeleton:
    """Parts and shapes for distances; for a robot without any, those of the model file.

    Raises:
        UsageError: the model cannot be loaded.
    """
    prepared = _of(spec)
    if prepared is not None:
        return prepared[1].gaps.skeleton
    loaded = load_arm(spec)
    return skeleton_of(loaded.model(), loaded.joints, spec.lower, spec.upper)


def search_of(spec: ArmSpec) -> tuple[Array, Array, Array]:
    """A clear pose and the ends (k,) of the box about it, rad (m); without shapes, the limits and their
    middle.
    """
    search = spec.around.search
    if search is None or not search.lower:
        prepared = _of(spec)
        search = None if prepared is None or not prepared[1].gaps.list else prepared[1].around.search
    if search is None:
        return 0.5 * (spec.lower + spec.upper), spec.lower, spec.upper
    home, lower, upper = (np.array(side) for side in (search.home, search.lower, search.upper))
    return home, lower, upper


POSES = 1024
"""Number of random poses."""
OWN_POSES, OWN_STEPS = 128, 16
"""Numbers of poses, and of samples of the line to each, at which limits of the user are evaluated."""
SEED = 22
"""Seed of the random poses: the same robot always has the same."""
LINE = 0.2
"""rad (m): the longest step of a joint between samples of a straight line; clear poses leave room."""
COARSE = 5
"""Number of samples of a line that are evaluated first: most lines that collide do so there."""


def one_turn(lower: Array, upper: Array, home: Array, slides: Mask) -> tuple[Array, Array]:
    """Ends (k,) of the ranges, within one turn about home: a hinge shows all its poses in one turn."""
    most = np.where(slides, upper - lower, np.minimum(upper - lower, 2.0 * math.pi))
    low = np.clip(home - 0.5 * most, lower, upper - most)
    return low, low + most


def reachable(clearance: Clearance) -> Reachable:
    """Reachable poses of an arm with shapes, within `clearance`."""
    skeleton, home = clearance.gaps.skeleton, clearance.home
    lower, upper = one_turn(skeleton.lower, skeleton.upper, home, skeleton.slides)
    candidates = np.random.default_rng(SEED).uniform(lower, upper, (POSES, len(home)))
    poses = candidates[_clear(clearance, candidates)]
    visible = poses[_visible_from_home(clearance, home, poses)]
    return Reachable(lower, upper, np.concatenate([home[None], visible]))


def _clear(clearance: Clearance, poses: Array) -> Mask:
    """Mask (T,) of poses at which every gap keeps the margin of searches."""
    return np.asarray(np.all(clearance.gaps.of_poses(poses) - TOLERANCE >= clearance.sought, axis=1))


def _visible_from_home(clearance: Clearance, home: Array, poses: Array) -> Mask:
    """Mask (T,) of poses with a straight clear line to home; a line ends at its first overlap."""
    visible = np.ones(len(poses), dtype=np.bool_)
    longest = np.abs(poses - home).max(axis=1)
    counts = np.maximum(COARSE, np.ceil(longest / LINE).astype(int))
    for fine in (False, True):
        indices = np.flatnonzero(visible)
        steps = [
            np.linspace(0.0, 1.0, int(counts[i]) if fine else COARSE, endpoint=False)[1:] for i in indices
        ]
        line = np.concatenate([[0.0], *steps])[1:]
        of = np.repeat(indices, [len(step) for step in steps])
        clear = _clear(clearance, home + line[:, None] * (poses[of] - home))
        visible[of[~clear]] = False
    return visible


def reachable_of(spec: ArmSpec) -> Reachable:
    """Reachable poses of an arm; without shapes or limits of the user's own, its ranges alone."""
    clearance = clearance_of(spec, {})
    if clearance is not None:
        return of_file(_cached_reachable, spec, lambda: reachable(clearance))
    ranges = ranges_of(spec)
    limits = made_limits(spec.limits, spec, None, {}, spec.names)
    user_limits = [one for one in limits if isinstance(one, SupportsBoxes)]
    return Reachable(
        *ranges,
        _allowed(user_limits, *ranges, search_of(spec)[0]) if user_limits else np.zeros((0, spec.dof)),
    )


def _allowed(user_limits: Sequence[SupportsBoxes], lower: Array, upper: Array, home: Array) -> Array:
    """Poses (n, k), home first, that limits of the user's own allow, with all samples of the line to home."""
    poses = np.random.default_rng(SEED).uniform(lower, upper, (OWN_POSES, len(home)))
    fractions = np.linspace(1.0, 0.0, OWN_STEPS, endpoint=False)[:, None]

    def allowed(pose: Array) -> bool:
        line = home + fractions * (pose - home)
        return all(limit.roughly("", pose)(line) for limit in user_limits)

    # a home that is not allowed is refused by name where motions about it are searched
    allowed_poses = [home, *(pose for pose in poses if allowed(pose))] if allowed(home) else []
    return np.array(allowed_poses).reshape(-1, len(home))


def ranges_of(spec: ArmSpec) -> tuple[Array, Array]:
    """Ends (k,) of the joints' ranges, rad (m); for a hinge, within one turn about home."""
    slides = np.array([axis.unit == "m" for axis in spec.axes])
    return one_turn(spec.lower, spec.upper, search_of(spec)[0], slides)


def completed(
    spec: ArmSpec,
    loaded: Loaded,
    leave: Pairs = frozenset(),
    weight: Callable[[Array], Array] | None = None,
    *,
    whole_file: bool,
) -> tuple[Surroundings, tuple[str, ...]]:
    """The robot's surroundings with all defaults, and sentences for a person to confirm.

    Args:
        spec: of the robot. loaded: its model.
        leave: pairs of links that an SRDF disables.
        weight: as of `weight_on_drives`.
        whole_file: also take the surroundings of the model file, and a floor at 0 if it has none and the base
            does not reach below. Otherwise a robot file describes the surroundings.

    Raises:
        UsageError: as `settled`.
    """
    around, confirm = spec.around, []
    if not around.collision.look:
        return around, ()
    if not gaps_of(loaded, spec.lower, spec.upper, Surroundings()).skeleton.shapes:
        return around, ()
    if whole_file:
        around, of_model_file = from_file(loaded, spec.lower, spec.upper, around)
        around, of_floor = with_floor(loaded, spec.lower, spec.upper, around)
        confirm += [*of_floor, *of_model_file]
    elif loaded.planes and around.floor is None:
        confirm.append(PLANE)
    defaults = settled(loaded, spec.lower, spec.upper, around, leave, weight)
    return defaults.around, (*confirm, *defaults.confirm)


def not_verified(loaded: Loaded, around: Surroundings) -> tuple[str, ...]:
    """Sentences on what the clearance of this robot does not cover."""
    ignored = [f"The distance of {one} and {other}." for one, other in around.collision.ignore]
    described = any((around.floor, around.box, around.wall, around.room, around.column))
    others = "Other obstacles, cables, and people."
    unknown = others if described else "Obstacles: no floor, box or wall is given. Cables, people."
    return (*ignored, *(sentence[0].upper() + sentence[1:] + "." for sentence in loaded.unverified), unknown)


def beside_base(skeleton: Skeleton) -> tuple[str, ...]:
    """A sentence on links that are fixed to the base together with more than their foot: a table."""
    fixed = dict.fromkeys(s.link for s in skeleton.shapes if s.part == 0 and not s.box)
    shaped = {shape.part for shape in skeleton.shapes}
    first = [skeleton.parts[p] for p in sorted(shaped) if p and skeleton.parent[p] == 0]
    if len(fixed) < 2 or not first:
        return ()
    return (f"The distance of {', '.join(first)} from what is fixed to the base: {', '.join(fixed)}.",)


def _of(spec: ArmSpec) -> tuple[Loaded, ClearanceDefaults, dict[str, tuple[Proof, ...]]] | None:
    if spec.model_file is None or not spec.around.collision.look:
        return None
    file = spec.model_file

    def made() -> tuple[Loaded, ClearanceDefaults, dict[str, tuple[Proof, ...]]]:
        loaded = load_arm(spec)
        weight = None if spec.around.search else weight_on_drives(spec)
        return loaded, settled(loaded, spec.lower, spec.upper, spec.around, disabled(file), weight), {}

    return of_file(_cached_clearances, spec, made)
