"""Implausible values in a model file: placeholder inertias, lengths in millimetres.

Inertias that somebody made up are alike on all links, or larger than the link. They are used as they are, and
one line asks: forces before the first log, and what a rehearsal shows, are as good as they are.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude_arm.loading.loaded_model import Loaded

if TYPE_CHECKING:
    import mujoco
from etude_arm.loading.inertia import NO_MASS

LEAST_ALIKE, ALIKE_SHARE = 3, 0.5
"""Parts that are alike, and more than this share of all: pairs of links of one size are no wonder."""
DIGITS = 9
"""Of kg m^2: figures that a file repeats agree to the last."""
SHOWN = 5
"""Names in a sentence."""


def made_up(loaded: Loaded) -> tuple[str, ...]:
    """A sentence, if there is reason for one, of what moves in the model."""
    model = loaded.model()
    parts = [b for b in range(1, model.nbody) if model.body_weldid[b] and model.body_mass[b] > NO_MASS]
    alike, large = _alike(model, parts), _large(model, parts)
    why = [f"those of {_few(alike)} are the same"] if alike else []
    why += [f"those of {_few(large)} are of bodies larger than these links"] if large else []
    if not why:
        return ()
    return (
        f"Inertias of the model file look like placeholders: {'; '.join(why)}. Before the first log forces "
        "are as good as they are: are they right?",
    )


def _alike(model: mujoco.MjModel, parts: list[int]) -> list[str]:
    """Parts that share one inertia, if they are most of all."""
    figures = {b: tuple(np.round(model.body_inertia[b], DIGITS).tolist()) for b in parts}
    if not figures:
        return []
    most, count = Counter(figures.values()).most_common(1)[0]
    if count < LEAST_ALIKE or count <= ALIKE_SHARE * len(parts):
        return []
    return [model.body(b).name for b in parts if figures[b] == most]


def _large(model: mujoco.MjModel, parts: list[int]) -> list[str]:
    """Parts whose radius of gyration is beyond all of the part that the file shows: shapes and joints.

    A body's mass lies inside it, so no radius of gyration about its centre is larger than the way from there
    to its farthest point. Parts of which the file shows nothing are not judged.
    """
    found = []
    for b in parts:
        centre, shown = model.body_ipos[b], []
        for g in np.flatnonzero(model.geom_bodyid == b):
            shown.append(float(np.linalg.norm(model.geom_pos[g] - centre) + model.geom_rbound[g]))
        if not shown:
            continue
        ends = [model.body_pos[k] for k in np.flatnonzero(model.body_parentid == b)]
        shown += [float(np.linalg.norm(end - centre)) for end in (np.zeros(3), *ends)]
        radius = float(np.sqrt(model.body_inertia[b].max() / model.body_mass[b]))
        if radius > max(shown):
            found.append(f"{model.body(b).name} ({radius:.2g} m of {max(shown):.2g})")
    return found


def _few(names: list[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{', '.join(names[:SHOWN])}{more}"


LARGEST = 20.0
"""m, across one shape that moves or from one joint to the next: no robot's, but a part of 2 cm in mm."""


def check_lengths(loaded: Loaded) -> None:
    """Raises a UsageError that names the first part that moves and is too large to be true."""
    model = loaded.model()
    for body in range(1, model.nbody):
        away = float(np.linalg.norm(model.body_pos[body]))
        if away > LARGEST and int(model.body_parentid[body]):
            what = f"'{model.body(body).name}' lies {away:.3g} m from the part that carries it"
            raise _in_mm(what, "Lengths are in m: divide those in mm by 1000.", loaded)
        mass, moment = float(model.body_mass[body]), float(model.body_inertia[body].max())
        if moment > mass * (0.5 * LARGEST) ** 2:
            across = 2.0 * float(np.sqrt(moment / mass))
            what = f"the inertia of '{model.body(body).name}' is that of {mass:.3g} kg {across:.3g} m apart"
            raise _in_mm(what, "Inertias are in kg m^2: divide those in kg mm^2 by 1e6.", loaded)
    for geom in range(model.ngeom):
        across = 2.0 * float(model.geom_rbound[geom])
        if across > LARGEST and int(model.geom_bodyid[geom]):
            what = f"a shape of '{model.geom(geom).name.rpartition('#')[0]}' is {across:.3g} m across"
            raise _in_mm(what, 'A mesh in mm needs scale="0.001 0.001 0.001" beside its name.', loaded)


def _in_mm(what: str, mend: str, loaded: Loaded) -> UsageError:
    return UsageError(
        f"{what}, which looks like mm, not m",
        where=loaded.source,
        next_step=f"{mend} If the figure is right, write the robot file by hand, with this model_file.",
    )
