"""An inverse dynamics model on disk: numbers in model.npz, everything else in model.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.models.features import FeatureMap
from etude.models.guard import Guard
from etude.models.inverse_dynamics import InverseDynamicsModel
from etude.models.physics.kinematics import KinematicTree
from etude.models.physics.rigid_body import RigidBodyModel
from etude.models.physics.transmission import Drive
from etude.models.posterior_file import posterior_arrays, posterior_of, posterior_words
from etude.models.two_files import Arrays, TwoFiles

Array = NDArray[np.float64]

FILES = TwoFiles("model.npz", "model.json", 1)
POINTWISE = ("offset", "scale", "prior_deviation", "stick_velocity")
TREE = tuple(KinematicTree.__dataclass_fields__)
GUARD = ("weights", "process_error", "linear_error")
RIGID = ("friction_velocity", "inertial", "extra", "rank", "deviation")


def save_model(model: InverseDynamicsModel, folder: str | Path) -> None:
    """Writes model.npz and then model.json into `folder`, each whole or not at all."""
    arrays: Arrays = {name: getattr(model, name) for name in POINTWISE}
    if model.features.friction_velocity is not None:
        arrays["friction_velocity"] = model.features.friction_velocity
    if model.residual_variance is not None:
        arrays["residual_variance"] = model.residual_variance
    for j, posterior in enumerate(model.posteriors):
        arrays |= {f"output{j}.{name}": array for name, array in posterior_arrays(posterior).items()}
    if model.fallback is not None:
        arrays |= _rigid_arrays(model.fallback)
    if model.guard is not None:
        arrays |= {f"guard.{name}": getattr(model.guard, name) for name in GUARD}
    words = {
        "kind": model.kind,
        "dof": model.dof,
        "friction_scales": model.features.friction_scales,
        "outputs": [posterior_words(posterior) for posterior in model.posteriors],
        "guard": None if model.guard is None else model.guard.roles,
    }
    FILES.write(Path(folder), arrays, words)


def load_model(folder: str | Path) -> InverseDynamicsModel:
    """The model that `save_model` wrote; predictions are the same to rounding.

    Raises:
        DataError: no model there, or a damaged or foreign one.
    """
    return FILES.read(Path(folder), _model, "model")


def _model(words: dict[str, Any], arrays: Arrays) -> InverseDynamicsModel:
    posteriors = tuple(posterior_of(row, arrays, f"output{j}.") for j, row in enumerate(words["outputs"]))
    return InverseDynamicsModel(
        kind=words["kind"],
        features=FeatureMap(
            words["dof"], arrays.get("friction_velocity"), tuple(map(float, words["friction_scales"]))
        ),
        posteriors=posteriors,
        fallback=_rigid_model(arrays) if "rigid.inertial" in arrays else None,
        residual_variance=arrays.get("residual_variance"),
        guard=_guard(words, arrays),
        **{name: arrays[name] for name in POINTWISE},
    )


def _guard(words: dict[str, Any], arrays: Arrays) -> Guard | None:
    if words.get("guard") is None:  # none needed, or stored before there were guards
        return None
    return Guard(tuple(words["guard"]), **{name: arrays[f"guard.{name}"] for name in GUARD})


def _rigid_arrays(model: RigidBodyModel) -> Arrays:
    arrays: Arrays = {f"rigid.{name}": getattr(model, name) for name in RIGID}
    arrays |= {f"tree.{name}": getattr(model.tree, name) for name in TREE}
    for j, drive in enumerate(model.drives):
        arrays |= {
            f"drive{j}.{name}": np.asarray(getattr(drive, name)) for name in Drive.__dataclass_fields__
        }
    return arrays


def _rigid_model(arrays: Arrays) -> RigidBodyModel:
    tree = KinematicTree(**{name: arrays[f"tree.{name}"] for name in TREE})
    drives = tuple(
        Drive(
            float(arrays[f"drive{j}.gear"]),
            *(arrays[f"drive{j}.{name}"] for name in ("coefficients", "bodies", "points")),
        )
        for j in range(tree.joints)
    )
    return RigidBodyModel(tree, drives, **{name: arrays[f"rigid.{name}"] for name in RIGID})
