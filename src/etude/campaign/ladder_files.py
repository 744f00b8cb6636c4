"""Where the models of a round lie: the chosen one in models/0007/, the others in a folder of their kind."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from etude.models.inverse_dynamics import InverseDynamicsModel
from etude.models.model_config import KINDS, Kind
from etude.models.model_file import load_model, save_model

MODEL = "model.json"


def save_models(folder: Path, models: Mapping[Kind, InverseDynamicsModel], chosen: Kind) -> list[Path]:
    """Stores every model, the chosen one last; returns the files."""
    folders = [folder / kind for kind in models if kind != chosen] + [folder]
    kinds = [kind for kind in models if kind != chosen] + [chosen]
    for kind, place in zip(kinds, folders, strict=True):
        save_model(models[kind], place)
    return [path for place in folders for path in sorted(place.glob("model.*"))]


def load_kind(folder: Path, kind: Kind) -> InverseDynamicsModel | None:
    """The model of that kind, or None if the round has none."""
    if (folder / kind / MODEL).exists():
        return load_model(folder / kind)
    chosen = load_model(folder)
    return chosen if chosen.kind == kind else None


def load_models(folder: Path) -> dict[Kind, InverseDynamicsModel]:
    """Every model of the round, by kind."""
    found = {kind: load_kind(folder, kind) for kind in KINDS}
    return {kind: model for kind, model in found.items() if model is not None}
