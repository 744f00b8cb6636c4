"""An inverse model of a vehicle on disk: numbers in flight_model.npz, the rest in flight_model.json."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from etude.models.flight.features import FlightFeatures
from etude.models.flight.model import FlightModel
from etude.models.gp.shared_exact import SharedPosterior, shared_posterior
from etude.models.physics.flight_inverse import FlightPhysics, VehicleInverse
from etude.models.physics.flight_linear import LinearInverse
from etude.models.posterior_file import kernel_of, kernel_words
from etude.models.student_t import StudentT
from etude.models.two_files import Arrays, TwoFiles, Words
from etude.robots.vehicle import Vehicle

FILES = TwoFiles("flight_model.npz", "flight_model.json", 1)
POINTWISE = ("offset", "deviation", "scale")
LINEAR = ("centre", "spread", "weights", "offset")


def save_flight_model(model: FlightModel, folder: str | Path) -> None:
    """Writes both files into `folder`, each whole or not at all."""
    arrays: Arrays = {name: getattr(model, name) for name in POINTWISE}
    if model.physics_variance is not None:
        arrays["physics_variance"] = model.physics_variance
    for j, process in enumerate(model.processes):
        first = process.outputs[0]
        arrays |= {f"process{j}.X": first.X, f"process{j}.theta": first.theta}
        arrays[f"process{j}.Y"] = np.column_stack([posterior.y for posterior in process.outputs])
    physics, physics_arrays = _physics_parts(model.physics)
    words = {
        "kind": model.kind,
        "features": asdict(model.features),
        "calibrated": model.calibrated,
        "student": None if model.student is None else asdict(model.student),
        "physics": physics,
        "processes": [_process_words(process) for process in model.processes],
    }
    FILES.write(Path(folder), arrays | physics_arrays, words)


def load_flight_model(folder: str | Path) -> FlightModel:
    """The model that `save_flight_model` wrote; on the same machine its predictions are the same bits.

    Raises:
        DataError: no model there, or a damaged or foreign one.
    """
    return FILES.read(Path(folder), _model, "flight model")


def _model(words: Words, arrays: Arrays) -> FlightModel:
    student = words["student"]
    return FlightModel(
        kind=words["kind"],
        features=FlightFeatures(**words["features"]),
        processes=tuple(_process(row, arrays, f"process{j}.") for j, row in enumerate(words["processes"])),
        calibrated=bool(words["calibrated"]),
        physics=_physics(words["physics"], arrays),
        physics_variance=arrays.get("physics_variance"),
        student=None if student is None else StudentT(**student),
        **{name: arrays[name] for name in POINTWISE},
    )


def _process_words(process: SharedPosterior) -> Words:
    kernel = kernel_words(process.outputs[0].kernel)
    return {"kernel": kernel, "noise_variance": process.noise_variance}


def _process(words: Words, arrays: Arrays, prefix: str) -> SharedPosterior:
    theta, X, Y = (arrays[prefix + name] for name in ("theta", "X", "Y"))
    return shared_posterior(kernel_of(words["kernel"]), theta, float(words["noise_variance"]), X, Y)


def _physics_parts(physics: FlightPhysics | None) -> tuple[Words | None, Arrays]:
    if physics is None:
        return None, {}
    if isinstance(physics, VehicleInverse):
        vehicle = {"form": "vehicle", "vehicle": asdict(physics.vehicle)}
        return vehicle, {"physics.coefficients": physics.coefficients}
    if isinstance(physics, LinearInverse):
        linear = {"form": "linear", "uses": list(physics.uses)}
        return linear, {f"physics.{name}": getattr(physics, name) for name in LINEAR}
    raise TypeError(f"physics of type {type(physics).__name__} have no form on disk yet")


def _physics(words: Words | None, arrays: Arrays) -> FlightPhysics | None:
    if words is None:
        return None
    if words["form"] == "vehicle":
        own = words["vehicle"]
        vehicle = Vehicle(**(own | {"inertia": tuple(own["inertia"])}))
        return VehicleInverse(vehicle, arrays["physics.coefficients"])
    if words["form"] == "linear":
        return LinearInverse(tuple(words["uses"]), **{name: arrays[f"physics.{name}"] for name in LINEAR})
    raise ValueError(f"unknown form {words['form']!r} of physics")
