"""Stored logs and models of trainings, verified against the journal, and groups of logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude._runtime.trusted_folders import folder_id
from etude.abilities import SupportsBody, SupportsPlant
from etude.campaign.record.config_file import trust_command
from etude.campaign.record.events import Trained
from etude.campaign.record.folder import Campaign, open_campaign, require_same_names
from etude.campaign.record.journal import JOURNAL, MODEL, recorded, require_intact, superseded
from etude.campaign.record.state import Round, State
from etude.campaign.record.stored_files import name_of, require_runs
from etude.codes import NextStep, Notice, Warn
from etude.errors import UsageError, typed
from etude.plugins import named_in
from etude.storage import sha256_of
from etude.types import Array, Log, Mask, Samples

if TYPE_CHECKING:
    from etude.models.learned_model import LearnedModel

LEFT_OUT = "left_out.npz"
LINEAR, MIXED = "linear", "mixed"
"""What every structure has to beat, and what is said where commands are made of several structures."""


def load_model(folder: str | Path) -> LearnedModel:
    """The newest model in a campaign folder. Errors as `newest_model`."""
    campaign = open_campaign(Path(folder))
    return newest_model(campaign, campaign.state())


def newest_model(campaign: Campaign, state: State) -> LearnedModel:
    """The model of the last training.

    Raises:
        UsageError: nothing was learned yet, or a file of the model is missing or was changed.
        DataError: the file is of another version.
    """
    if not state.trained:
        raise UsageError(
            "nothing has been learned yet", where=str(campaign.path), next_step="Ingest a log first."
        )
    check_model(campaign, state)
    return stored_model(campaign, state.trained[-1].number)


def check_model(campaign: Campaign, state: State) -> None:
    """Compares the newest model's file, if any, with the journal; a damaged file may still load.

    Raises:
        UsageError: the file is missing or was changed.
    """
    if not state.trained:
        return
    number = state.trained[-1].number
    trained = [e for e in campaign.events() if isinstance(e.fact, Trained) and e.number == number]
    require_intact(campaign.path, trained[-1].files, _advice(campaign, number))


def prune(campaign: Campaign) -> None:
    """Deletes the models that newer trainings superseded; the caller holds the lock."""
    for name in superseded(campaign.events()):
        (campaign.path / name).unlink(missing_ok=True)


def is_pruned(campaign: Campaign, number: int) -> bool:
    """Whether the model of round `number` was deleted because newer ones superseded it."""
    path = campaign.model_folder(number) / MODEL
    return not path.exists() and name_of(campaign, path) in superseded(campaign.events())


def _advice(campaign: Campaign, number: int) -> str:
    return (
        f"Restore it from a copy, or train again: etude abandon {typed(campaign.path)} {number}, then "
        "ingest its log again."
    )


def require_stored(campaign: Campaign, number: int) -> str:
    """SHA-256 of the model of round `number`; "" if it is missing. UsageError: it was changed."""
    path = campaign.model_folder(number) / MODEL
    if not path.is_file():
        return ""
    digest = sha256_of(path)
    if recorded(campaign.events()).get(name_of(campaign, path)) != digest:
        raise UsageError(
            f"{name_of(campaign, path)} was changed after Étude stored it",
            where=str(campaign.path),
            next_step=_advice(campaign, number),
        )
    return digest


KEPT_LOGS = 2**26
"""Bytes of stored logs that a campaign keeps in memory: a tell asks for each of them up to three times."""


def stored_log(campaign: Campaign, number: int) -> Log:
    """The log of that number as ingested. UsageError: its file is missing or was changed. DataError: it
    cannot be read.
    """
    from etude.logs.readers.log_file import read_log_file

    require_runs(campaign, [number])
    path, cache = campaign.run_file(number), campaign.logs
    digest = recorded(campaign.events()).get(name_of(campaign, path), "")
    if digest in cache:
        return cache[digest]
    log = read_log_file(path)
    if digest and sum(_bytes(one) for one in (*cache.values(), log)) <= KEPT_LOGS:
        cache[digest] = log
    return log


def _bytes(log: Log) -> int:
    return log.t.nbytes + sum(values.nbytes for values in log.values.values())


def stored_model(campaign: Campaign, number: int) -> LearnedModel:
    """The model of round `number`; it is read once while its file exists.

    Raises:
        DataError: the file is missing or damaged. UsageError: it is not the committed one.
    """
    path = campaign.model_folder(number)
    digest = require_stored(campaign, number)
    if digest not in campaign.models:
        campaign.models.clear()  # only the last one read: models are large
        campaign.models[digest] = read_stored(campaign, path / MODEL)
    return campaign.models[digest]


def read_stored(campaign: Campaign, path: Path) -> LearnedModel:
    """The model in a file of the campaign; code that it names runs only in a trusted folder.

    UsageError: its commands have other names now, or another order.
    """
    from etude.models.store import load_model as read_model

    kind, spec, config, folder = campaign.kind, campaign.spec, campaign.config, campaign.path
    with named_in(path, folder, folder_id(folder / JOURNAL), trust_command(folder)):
        model = read_model(path, kind.inputs(spec, config).restore, kind.physics(spec, config))
    require_same_names(model.commands, campaign.command.parts, folder)
    return model


def only_structure(model: LearnedModel, structure: str) -> LearnedModel | None:
    """The model with that structure for all commands; None if the structure was not trained for all."""
    try:
        return model.of_structure(structure)
    except UsageError:
        return None


def body_of(campaign: Campaign) -> str:
    """Hash of the moving body in robot.toml; "" for a kind that does not give it."""
    kind = campaign.kind
    return kind.body(campaign.spec) if isinstance(kind, SupportsBody) else ""


def of_another_body(campaign: Campaign, number: int) -> str:
    """A sentence if robot.toml now describes another body than when log `number` was learned; "" otherwise.

    For events without a body, the whole of robot.toml is compared.
    """
    body, file = "", ""
    for event in campaign.events():
        if isinstance(event.fact, Trained) and event.number == number:
            body, file = event.fact.body, event.robot_sha256
    if body == body_of(campaign) if body else file in ("", campaign.robot_sha256):
        return ""
    ingested = campaign.state().rounds[number].ingested
    log = ingested.source if ingested is not None else "LOG"
    return (
        f" robot.toml changed after the training on log {number}, so its physics differ. If the robot "
        "itself changed, ingest its next log with --changed new. If robot.toml was wrong: etude untell "
        f"{typed(campaign.path)} {number}, then etude tell {typed(campaign.path)} {typed(log)}."
    )


def label(structures: Sequence[str]) -> str:
    """One word for the structures of the commands."""
    return structures[0] if len(set(structures)) == 1 else MIXED


def is_learned(state: State) -> bool:
    """Whether every log that awaits no answer is in the model."""
    return not state.pending


STILL = 0.02
"""Part of a coordinate's range, at most one turn of it, in which it is held and sags while others move."""


def held_commands(campaign: Campaign, paths: Sequence[Array]) -> Mask:
    """Mask (J,) of commands whose coordinate is at rest in all logs, if each coordinate has its own command.

    Args:
        campaign: the folder.
        paths: positions (T, k) of each log that has them.
    """
    if campaign.command.parts != campaign.axes or not paths:
        return np.zeros(len(campaign.command.parts), dtype=bool)
    low, high = campaign.kind.expected(campaign.spec).limits[campaign.kind.path]
    width = np.minimum(np.asarray(high, dtype=float) - low, 2.0 * np.pi)
    reached = np.max([q.max(axis=0) for q in paths], axis=0) - np.min([q.min(axis=0) for q in paths], axis=0)
    return np.asarray(reached < STILL * width)


def ingested_samples(campaign: Campaign, numbers: Sequence[int]) -> Samples:
    """Samples of stored logs; each segment is a group, in the order of `numbers` and of time.

    A log that repeats another one joins its groups, because it is no new evidence about new motions.
    """
    logs = [stored_log(campaign, number) for number in numbers]
    groups = []
    for log, segments in zip(logs, groups_of(campaign, numbers).values(), strict=True):
        place = np.searchsorted([start for start, _ in segments], log.t, side="right") - 1
        groups.append(np.array([group for _, group in segments], dtype=np.int64)[np.maximum(place, 0)])
    return campaign.kind.samples(campaign.spec, campaign.config, logs, groups)


def groups_of(campaign: Campaign, numbers: Sequence[int]) -> dict[int, list[tuple[float, int]]]:
    """Start times of the segments (s) and their groups, for each of those logs; a repeated log has its own
    groups.
    """
    rounds, count = campaign.state().rounds, 0
    groups: dict[int, list[tuple[float, int]]] = {}
    for number in numbers:
        ingested = rounds[number].ingested
        starts = ingested.segments if ingested else (0.0,)
        repeats = groups.get(ingested.repeats) if ingested and ingested.repeats is not None else None
        last = 0 if repeats is None else len(repeats) - 1
        groups[number] = [
            (start, count + i if repeats is None else repeats[min(i, last)][1])
            for i, start in enumerate(starts)
        ]
        count += len(starts) if repeats is None else 0
    return groups


def known_groups(campaign: Campaign, numbers: Sequence[int]) -> int:
    """Number of groups in those logs."""
    return len({group for segments in groups_of(campaign, numbers).values() for _, group in segments})


SIMULATED = "simulated"
"""The folder of a campaign with the logs that its simulated robot left."""


def simulated_logs(campaign: Campaign, state: State) -> list[Round]:
    """Used rounds whose log is from `etude simulate`, by number."""
    return [r for r in state.ingested if _has_simulated_log(campaign, r)]


def real_logs(campaign: Campaign, state: State) -> list[Round]:
    """Used rounds whose log is from elsewhere, by number."""
    return [r for r in state.ingested if not _has_simulated_log(campaign, r)]


def mixed(campaign: Campaign, state: State) -> tuple[Notice, ...]:
    """A warning if a model learns from a robot and from simulations of its model file.

    A built-in robot has its own plant, so its simulations count as real.
    """
    simulated, real = simulated_logs(campaign, state), real_logs(campaign, state)
    built_in = isinstance(campaign.spec, SupportsPlant) and campaign.spec.plant is not None
    if not simulated or not real or built_in:
        return ()
    numbers = tuple(r.number for r in simulated)
    fields = {
        "simulated": numbers,
        "real": real[0].number,
        "folder": str(campaign.path),
        "newest": numbers[-1],
    }
    return (Notice(Warn.TWO_ROBOTS, fields, NextStep.UNTELL_SIMULATED),)


def _has_simulated_log(campaign: Campaign, one: Round) -> bool:
    return (campaign.path / SIMULATED / f"{one.number:04d}.parquet").is_file()
