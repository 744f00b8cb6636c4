"""Links whose shapes often touch others: those are worth finer shapes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from etude.contracts import Array
from etude.robots.arm.loading.loaded import Loaded

if TYPE_CHECKING:
    import mujoco

POSES = 100
OFTEN = 0.05
"""Share of poses: pairs that overlap more often are looked at."""
REACH = 1.0
"""m: distances beyond do not matter."""


def crowded_links(loaded: Loaded, lower: Array, upper: Array) -> set[str]:
    """Links with a shape that overlaps another in more than OFTEN of POSES even poses within the limits (J,).

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
    often = [pair for pair, count in zip(pairs, hits, strict=True) if count > OFTEN * POSES]
    return {str(model.geom(geom).name).rpartition("#")[0] for pair in often for geom in pair}


def _pairs(model: mujoco.MjModel) -> Iterator[tuple[int, int]]:
    body, parent = model.geom_bodyid, model.body_parentid
    for a in range(model.ngeom):
        for b in range(a + 1, model.ngeom):
            one, other = int(body[a]), int(body[b])
            if one != other and parent[one] != other and parent[other] != one:
                yield a, b
