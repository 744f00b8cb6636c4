"""Defaults of a robot file's collision tables: ignored pairs, home pose, box of the search.

An SRDF lists pairs that may be ignored. Many files also list pairs that can be kept apart: a hand and the
link two joints before it, or every pair without a collision in a few thousand poses.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.clearance.clear_pose import box_about, clearest
from etude_arm.clearance.distances import TOLERANCE, Gap, Gaps
from etude_arm.clearance.hull_reduction import hull_proxies
from etude_arm.clearance.pairs import gaps_of
from etude_arm.clearance.surroundings import Search, Surroundings
from etude_arm.loading.loaded_model import Loaded

DIGITS = 4
"""Of home and box, since people read them."""
ROUND = 10.0**DIGITS
SEED = 20
"""Seed of the random poses: a robot file always gives the same defaults."""
POSES = 1024  # of a pair that overlaps in one pose of 100 they miss 3 in 100,000
ALWAYS = 0.95
"""Fraction of random poses above which two shapes count as overlapping by construction."""
OFTEN = 0.5
"""The same for a pair that an SRDF disables."""
NEIGHBOUR_JOINTS = 2
"""Joints between two parts whose shapes may overlap at home; farther apart it is no artefact of shapes."""
STILL = 0.001
"""m, largest change of the distance between a foot and the object that it turns on."""
OVERLAP_POSES = 64
"""Number of poses for this check."""


@dataclass(frozen=True, eq=False)
class ClearanceDefaults:
    """A robot and its surroundings with all defaults.

    Attributes:
        gaps: the checked distances.
        around: the surroundings, with ignored pairs and the search's home and box.
        confirm: a sentence for each omitted pair, to be confirmed by the user.
    """

    gaps: Gaps
    around: Surroundings
    confirm: tuple[str, ...]


NEVER = "Never"
"""SRDF reason of pairs that were never seen to collide; these are not ignored."""

Pairs = frozenset[frozenset[str]]


def disabled(model_file: Path) -> Pairs:
    """Pairs of links that the model's SRDF disables, except those that it disables because they never
    collide.

    Raises:
        UsageError: the SRDF is not XML.
    """
    path = next((path for path in _places(model_file) if path.is_file()), None)
    if path is None:
        return frozenset()
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as problem:
        raise UsageError(
            f"not a readable SRDF: {problem}", where=str(path), next_step="Correct it, or move it away."
        ) from None
    pairs = [one for one in root.iter("disable_collisions") if one.get("reason") != NEVER]
    return frozenset(frozenset((one.get("link1", ""), one.get("link2", ""))) for one in pairs)


def _places(model_file: Path) -> list[Path]:
    """Places of an SRDF: beside the model file, and in the folder srdf next to its folder."""
    name = model_file.with_suffix(".srdf").name
    return [model_file.parent / name, model_file.parent.parent / "srdf" / name]


def settled(
    loaded: Loaded,
    lower: Array,
    upper: Array,
    around: Surroundings,
    leave: Pairs = frozenset(),
    weight: Callable[[Array], Array] | None = None,
) -> ClearanceDefaults:
    """Defaults: pairs that overlap by construction are omitted and listed; a clear home; a box about it.

    Args:
        loaded: the robot. lower, upper: (k,) limits of its joints, rad (m).
        around: its surroundings.
        leave: pairs of links that may touch, if they often do.
        weight: see `clearest`.

    Raises:
        UsageError: at home, parts overlap that are no neighbours, or the robot overlaps its surroundings.
    """
    rng = np.random.default_rng(SEED)
    gaps = gaps_of(loaded, lower, upper, around)
    confirm: list[str] = []
    if around.search is None:
        share = _overlaps(gaps, rng)
        always = [gap for gap, part in zip(gaps.list, share, strict=True) if part > _often(gap, leave)]
        confirm += _sentences(always, "overlap in nearly every pose")
        gaps, around = _without(loaded, gaps, around, always)
    home = np.array(around.search.home) if around.search else np.round(clearest(gaps, rng, weight), DIGITS)
    touching = _touching(gaps, home, leave, by_user=around.search is not None and bool(around.search.lower))
    confirm += _sentences(touching, "overlap at home")
    gaps, around = _without(loaded, gaps, around, touching)
    if proxies := hull_proxies(gaps, home):
        gaps = gaps_of(loaded, lower, upper, around, proxies)
    if around.search is None or not around.search.lower:
        low, high = box_about(gaps, home, around.collision.margin, rng) if gaps.list else (lower, upper)
        inside = np.ceil(low * ROUND) / ROUND, np.floor(high * ROUND) / ROUND
        around = replace(around, search=Search(*(tuple(ends.tolist()) for ends in (home, *inside))))
    return ClearanceDefaults(gaps, around, tuple(confirm))


def _overlaps(gaps: Gaps, rng: np.random.Generator) -> Array:
    """Fraction (n,) of random poses with overlap, for each gap."""
    return np.asarray((gaps.of_poses(gaps.skeleton.random_poses(rng, POSES)) <= 0.0).mean(axis=0))


def _often(gap: Gap, leave: Pairs) -> float:
    """Fraction of random poses with overlap above which a gap is omitted."""
    return OFTEN if frozenset(gap.names) in leave else ALWAYS


def _touching(gaps: Gaps, home: Array, leave: Pairs, by_user: bool) -> list[Gap]:
    """Gaps with overlap at home; each must be between near parts, or allowed by the SRDF.

    Raises:
        UsageError: another gap overlaps, or any gap overlaps at a home that the user gave.
    """
    distances = gaps.of_poses(home[None])[0]
    touching = [
        gap for gap, distance in zip(gaps.list, distances, strict=True) if distance <= 2.0 * TOLERANCE
    ]
    bad = [gap for gap in touching if by_user or not _may_touch(gaps, gap, leave)]
    if bad:
        texts = sorted({gap.text for gap in bad})
        raise UsageError(
            f"at home {'; '.join(texts[:5])}{' and others' if len(texts) > 5 else ''} overlap",
            where="search.home",
            next_step="Correct the obstacles, state another home or remove [search] from the robot file, "
            "or name the pair in [collision] ignore.",
        )
    return touching


def _may_touch(gaps: Gaps, gap: Gap, leave: Pairs) -> bool:
    """Whether two shapes may overlap: parts near each other, or a foot that turns."""
    shapes, skeleton = gaps.skeleton.shapes, gaps.skeleton
    one = shapes[gap.one].part
    if gap.other < 0 or shapes[gap.other].box:
        poses = skeleton.random_poses(np.random.default_rng(SEED), OVERLAP_POSES)
        distance = gaps.of_poses(poses)[:, gaps.list.index(gap)]
        return bool(np.ptp(distance) < STILL)
    joints = int(skeleton.between(one, shapes[gap.other].part).sum())
    return frozenset(gap.names) in leave or joints <= NEIGHBOUR_JOINTS


def _without(
    loaded: Loaded, gaps: Gaps, around: Surroundings, left_out: list[Gap]
) -> tuple[Gaps, Surroundings]:
    if not left_out:
        return gaps, around
    names = tuple(dict.fromkeys(gap.names for gap in left_out))
    ignore = (*around.collision.ignore, *names)
    around = replace(around, collision=replace(around.collision, ignore=ignore))
    return gaps_of(loaded, gaps.skeleton.lower, gaps.skeleton.upper, around), around


def _sentences(gaps: list[Gap], why: str) -> list[str]:
    texts = dict.fromkeys(gap.text for gap in gaps)
    return [f"The shapes of {text} {why}: their distance is not verified." for text in texts]
