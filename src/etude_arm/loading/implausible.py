"""Implausible values in a model file: placeholder inertias, lengths in millimetres.

Placeholder inertias are equal on all links, or too large for the link. Étude uses them unchanged and prints
one question: torques before the first log, and the simulation, depend on them.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude_arm.loading.inertia import NO_MASS
from etude_arm.loading.load import load_arm, of_file
from etude_arm.loading.loaded_model import Loaded
from etude_arm.spec import ArmSpec

if TYPE_CHECKING:
    import mujoco

LEAST_ALIKE, ALIKE_SHARE = 3, 0.5
"""Least number of parts with equal inertia, and least share of all parts: two links of one size are common.
"""
DIGITS = 9
"""Decimals of kg m^2 to which equal inertias agree."""
SHOWN = 5
"""Largest number of names in a sentence."""


_cached: dict[str, bool] = {}


def alike(spec: ArmSpec) -> bool:
    """Whether most moving parts of the robot's model file share one inertia; no mesh is read."""
    if spec.model_file is None or not spec.model_file.is_file():
        return False
    return of_file(_cached, spec, lambda: bool(_sharing_one_inertia(*_parts(load_arm(spec, shapes=False)))))


def _parts(loaded: Loaded) -> tuple[mujoco.MjModel, list[int]]:
    """The model, and its moving parts that have a mass."""
    model = loaded.model()
    return model, [b for b in range(1, model.nbody) if model.body_weldid[b] and model.body_mass[b] > NO_MASS]


def placeholder_sentences(loaded: Loaded) -> tuple[str, ...]:
    """A sentence on placeholder inertias of the moving parts; () if there are none."""
    model, parts = _parts(loaded)
    same, large = _sharing_one_inertia(model, parts), _large(model, parts)
    why = [f"those of {_few(same)} are the same"] if same else []
    why += [f"those of {_few(large)} are of bodies larger than these links"] if large else []
    if not why:
        return ()
    return (
        f"Inertias of the model file look like placeholders: {'; '.join(why)}. Before the first log, "
        "forces depend on them: check them.",
    )


def _sharing_one_inertia(model: mujoco.MjModel, parts: list[int]) -> list[str]:
    """Parts that share one inertia, if they are the majority."""
    figures = {b: tuple(np.round(model.body_inertia[b], DIGITS).tolist()) for b in parts}
    if not figures:
        return []
    most, count = Counter(figures.values()).most_common(1)[0]
    if count < LEAST_ALIKE or count <= ALIKE_SHARE * len(parts):
        return []
    return [model.body(b).name for b in parts if figures[b] == most]


def _large(model: mujoco.MjModel, parts: list[int]) -> list[str]:
    """Parts whose radius of gyration exceeds the extent of their shapes and joints.

    The mass of a body lies inside it. So its radius of gyration about the centre of mass is at most the
    distance from there to its farthest point. Parts without shapes are skipped.
    """
    large = []
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
            large.append(f"{model.body(b).name} ({radius:.2g} m of {max(shown):.2g})")
    return large


def _few(names: list[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{', '.join(names[:SHOWN])}{more}"


LARGEST = 20.0
"""m: largest plausible size of a moving shape, and distance between joints. A part of 2 cm in mm reaches it.
"""


def check_lengths(loaded: Loaded) -> None:
    """Raises a UsageError that names the first moving part with an implausible length."""
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
            raise _in_mm(what, 'A mesh in mm needs scale="0.001 0.001 0.001" after its name.', loaded)


def _in_mm(what: str, mend: str, loaded: Loaded) -> UsageError:
    return UsageError(
        f"{what}, which looks like mm, not m",
        where=loaded.source,
        next_step=f"{mend} If the figure is right, write the robot file by hand, with this model_file.",
    )
