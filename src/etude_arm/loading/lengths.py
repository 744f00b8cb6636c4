"""Lengths and inertias that look like those of millimetres: meshes without their scale, above all."""

from __future__ import annotations

import numpy as np

from etude.errors import UsageError
from etude_arm.loading.loaded import Loaded

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
