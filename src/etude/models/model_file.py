"""An inverse dynamics model on disk: numbers in model.npz, everything else in model.json."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.models.features import FeatureMap
from etude.models.guard import Guard
from etude.models.inverse_dynamics import InverseDynamicsModel
from etude.models.physics.kinematics import KinematicTree
from etude.models.physics.rigid_body import RigidBodyModel
from etude.models.physics.transmission import Drive
from etude.models.posterior_file import posterior_arrays, posterior_of, posterior_words
from etude.storage import write_atomic

Array = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

VERSION = 1
NUMBERS, WORDS = "model.npz", "model.json"
POINTWISE = ("offset", "scale", "prior_deviation", "stick_velocity")
TREE = tuple(KinematicTree.__dataclass_fields__)
GUARD = ("weights", "process_error", "linear_error")
RIGID = ("friction_velocity", "inertial", "extra", "rank", "deviation")


def save_model(model: InverseDynamicsModel, folder: str | Path) -> None:
    """Writes model.npz and then model.json into `folder`, each whole or not at all."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
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
        "version": VERSION,
        "kind": model.kind,
        "dof": model.dof,
        "friction_scales": model.features.friction_scales,
        "outputs": [posterior_words(posterior) for posterior in model.posteriors],
        "guard": None if model.guard is None else model.guard.roles,
    }
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    write_atomic(folder / NUMBERS, buffer.getvalue())
    write_atomic(folder / WORDS, json.dumps(words, indent=1).encode())


def load_model(folder: str | Path) -> InverseDynamicsModel:
    """The model that `save_model` wrote; predictions are the same to rounding.

    Raises:
        DataError: no model there, or a damaged or foreign one.
    """
    folder = Path(folder)
    try:
        words = json.loads((folder / WORDS).read_text(encoding="utf-8"))
        # from memory: NumPy leaves a damaged file open
        with np.load(io.BytesIO((folder / NUMBERS).read_bytes()), allow_pickle=False) as file:
            arrays = dict(file)
        if words["version"] != VERSION:
            raise ValueError(f"version {words['version']}")
        return _model(words, arrays)
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile) as error:
        raise DataError(
            f"this is no model that can be read ({error})",
            where=str(folder),
            next_step="Remove the folder and learn the logs again.",
        ) from error


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
