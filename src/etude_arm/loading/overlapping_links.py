"""Overlapping links: links whose shapes overlap others in many poses, which get finer shapes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array
from etude_arm.loading.loaded_model import Loaded

if TYPE_CHECKING:
    import mujoco

POSES = 100  # number of poses, over which the share with an overlap is computed
OFTEN = 0.05
"""Share of poses from which a pair gets finer shapes."""
REACH = 1.0
"""m: larger distances are not computed."""


OVERLAP_SHARE = 0.5
"""Share of poses from which a pair restricts motions strongly."""
Overlaps = Mapping[tuple[str, str], float]
"""Pairs of links -> share of poses in which their shapes overlap."""


def overlaps_of(loaded: Loaded, lower: Array, upper: Array) -> Overlaps:
    """Pairs whose shapes overlap in some of POSES even poses within the limits (J,).

    Shapes of one moving part, and of neighbours across one joint, are not compared.
    """
    import mujoco

    model = loaded.model()
    data = mujoco.MjData(model)
    pairs = list(_pairs(model))
    columns = loaded.columns(model)
    hits = np.zeros(len(pairs))
    for q in np.random.default_rng(0).uniform(lower, upper, (POSES, len(columns))):
        data.qpos[columns] = q
        mujoco.mj_kinematics(model, data)
        hits += [mujoco.mj_geomDistance(model, data, a, b, REACH, None) < 0 for a, b in pairs]
    overlaps: dict[tuple[str, str], float] = {}
    for (a, b), share in zip(pairs, (hits / POSES).tolist(), strict=True):
        links = _link(model, a), _link(model, b)
        if share:
            overlaps[links] = max(share, overlaps.get(links, 0.0))
    return overlaps


def links_that_overlap(overlaps: Overlaps) -> set[str]:
    """Links of pairs that overlap in more than OFTEN of the poses."""
    return {link for pair, share in overlaps.items() if share > OFTEN for link in pair}


def overlap_sentences(overlaps: Overlaps, ignored: Collection[tuple[str, str]]) -> tuple[str, ...]:
    """A sentence on pairs that overlap in more than MOST of the poses and are still checked."""
    shares = {
        pair: share
        for pair, share in overlaps.items()
        if share > OVERLAP_SHARE and not {pair, pair[::-1]} & set(ignored)
    }
    if not shares:
        return ()
    text = ", ".join(f"{one} and {other} in {share:.0%}" for (one, other), share in shares.items())
    return (
        f"Shapes overlap in most poses, which leaves little room for motions: {text}. If these links do "
        "not touch on the robot, their shapes are too large or misplaced in the model file: correct "
        "them, or name the pair in ignore of [collision].",
    )


def _link(model: mujoco.MjModel, geom: int) -> str:
    return str(model.geom(geom).name).rpartition("#")[0]


def _pairs(model: mujoco.MjModel) -> Iterator[tuple[int, int]]:
    body, parent = model.geom_bodyid, model.body_parentid
    for a in range(model.ngeom):
        for b in range(a + 1, model.ngeom):
            one, other = int(body[a]), int(body[b])
            if one != other and parent[one] != other and parent[other] != one:
                yield a, b
