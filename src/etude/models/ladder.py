"""The model ladder: every kind of model the robot allows, and the one that predicts new motion best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.models.blocks import split_blocks
from etude.models.calibration import Score, score
from etude.models.dataset import Dataset
from etude.models.inverse_dynamics import InverseDynamicsModel, physics_alone, train_model
from etude.models.model_config import PHYSICS, Kind, ModelConfig
from etude.models.physics.geometry import Geometry, read_geometry
from etude.models.selection import in_order
from etude.robots.spec import RobotSpec

Array = NDArray[np.float64]

FORCES = ("N m", "N")
"""Command units that a model file's inertial parameters predict by themselves."""


@dataclass(frozen=True)
class Ladder:
    """All trained models and the choice among them.

    Attributes:
        models: by kind.
        chosen: the kind in use.
        scores: by kind, of models that had not seen the motion they are scored on.
    """

    models: dict[Kind, InverseDynamicsModel]
    chosen: Kind
    scores: dict[str, Score]

    @property
    def model(self) -> InverseDynamicsModel:
        """The model in use."""
        return self.models[self.chosen]


def prequential(models: Mapping[Kind, InverseDynamicsModel], new: Dataset) -> dict[str, Score]:
    """Score of each model on a motion that none of them has seen."""
    moving = ~new.stuck
    return {
        kind: score(new.tau, *model.predict(new.q, new.qd, new.qdd), moving) for kind, model in models.items()
    }


def train_ladder(
    dataset: Dataset,
    spec: RobotSpec,
    config: ModelConfig,
    rng: np.random.Generator,
    previous: Mapping[Kind, InverseDynamicsModel] | None = None,
) -> Ladder:
    """Trains every kind that `config` and the robot allow, and chooses one.

    The choice is by error on the newest trajectory, predicted before it was learned: by the `previous` models
    if there are any, else by models of the earlier trajectories; of a single trajectory, blocks are held out.

    Raises:
        UsageError: a kind is named that the robot does not allow.
        DataError: an axis never moved.
    """
    dataset = in_order(dataset)
    geometry = None if config.kind == "gp" else read_geometry(spec)
    kinds = _kinds(config, spec, geometry)
    if len(kinds) == 1 and not previous:
        return Ladder(_train(kinds, dataset, spec, config, rng, geometry, {}), kinds[0], {})
    newest = dataset.group == dataset.group.max()
    if previous:
        scores = prequential(previous, dataset.take(newest))
    else:
        known, new = split_blocks(dataset) if newest.all() else (dataset.take(~newest), dataset.take(newest))
        scores = prequential(_train(kinds, known, spec, config, rng, geometry, {}), new)
    models = _train(kinds, dataset, spec, config, rng, geometry, previous or {})
    return Ladder(models, _choose(kinds, scores), scores)


def _kinds(config: ModelConfig, spec: RobotSpec, geometry: Geometry | None) -> tuple[Kind, ...]:
    """The rungs; the model file alone predicts commands only where they are forces."""
    if config.kind != "auto":
        return (config.kind,)
    if geometry is None:
        return ("gp",)
    rungs: tuple[Kind, ...] = ("gp", "identified+gp", "identified")
    return (*rungs, "nominal") if spec.command_unit in FORCES else rungs


def _train(
    kinds: tuple[Kind, ...],
    dataset: Dataset,
    spec: RobotSpec,
    config: ModelConfig,
    rng: np.random.Generator,
    geometry: Geometry | None,
    previous: Mapping[Kind, InverseDynamicsModel],
) -> dict[Kind, InverseDynamicsModel]:
    models: dict[Kind, InverseDynamicsModel] = {}
    for kind in kinds:
        twin = models.get("identified+gp")
        if kind in PHYSICS and twin is not None and geometry is not None:
            models[kind] = physics_alone(twin, kind, dataset, spec, geometry)
            continue
        own = replace(config, kind=kind)
        models[kind] = train_model(dataset, spec, own, rng, previous.get(kind), geometry)
    return models


def _choose(kinds: tuple[Kind, ...], scores: Mapping[str, Score]) -> Kind:
    """The kind with the least nMSE, averaged over the outputs; the first of `kinds` if nothing was scored."""
    known = [kind for kind in kinds if kind in scores and np.isfinite(scores[kind].nmse).any()]
    return min(known, key=lambda kind: float(np.nanmean(scores[kind].nmse)), default=kinds[0])
