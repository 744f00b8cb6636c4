"""Configuration file of a campaign: campaign.toml, which people edit by hand."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from etude import plugins
from etude._runtime.trusted_folders import folder_id, is_trusted, names_in, require_trusted, trust
from etude.campaign.record.config import SECTIONS, CampaignConfig, preset_config
from etude.campaign.record.journal import JOURNAL
from etude.errors import UsageError, typed
from etude.protocols import Kind
from etude.storage import unreadable
from etude.toml_tables import CORRECT, decoded, read_table, refuse_unknown, write_table

CONFIG = "campaign.toml"


@dataclass(frozen=True)
class ConfigFile:
    """The contents of a campaign.toml.

    Attributes:
        config: the configuration.
        kind: of the robot.
        sha256: of the file's bytes.
    """

    config: CampaignConfig
    kind: Kind
    sha256: str


def load_config(folder: Path) -> ConfigFile:
    """The campaign.toml in `folder`.

    Raises:
        UsageError: the folder holds no campaign, or a value is invalid; names the file and the key.
    """
    path = folder / CONFIG
    try:
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise UsageError(
            "there is no campaign here",
            where=str(path),
            next_step="Start one: etude init FOLDER --robot NAME.",
        ) from None
    except OSError as error:
        raise unreadable(path, error) from error
    require_trusted_names(folder, CONFIG, _names(data, str(path)))
    return parse_config(data, str(path))


def require_trusted_names(folder: Path, file: str, named: Mapping[str, str]) -> None:
    """Raises UsageError if a file of the campaign names code and this user does not trust the folder."""
    if named:
        require_trusted(named, folder / file, folder, folder_id(folder / JOURNAL), trust_command(folder))


def trust_campaign(folder: Path) -> None:
    """Adds the campaign's folder to this user's list; code that its files name may then run.

    Raises:
        UsageError: the folder holds no campaign. OSError: the list cannot be written.
    """
    identity = folder_id(folder / JOURNAL)
    if not identity:
        raise UsageError("there is no campaign here", where=str(folder), next_step="Check the path.")
    if not is_trusted(folder, identity):
        trust(folder, identity)


def trust_command(folder: Path) -> str:
    """The command that trusts the campaign in a folder."""
    return f"etude status {typed(folder)} --trust"


def _names(data: bytes, where: str) -> dict[str, str]:
    """Code that a campaign.toml names; names of log columns are not code."""
    try:
        table = decoded(data.decode(), where)
    except UnicodeDecodeError:
        return {}  # said by whoever reads it
    return names_in({name: value for name, value in table.items() if name != "log"})


def parse_config(data: bytes, where: str) -> ConfigFile:
    """The configuration in the bytes of a campaign.toml. Errors as `load_config`."""
    try:
        table = decoded(data.decode(), where)
    except UnicodeDecodeError as error:
        raise UsageError(f"not valid TOML: {error}", where=where, next_step=CORRECT) from None
    refuse_unknown(table, ["kind", "preset", "seed", *SECTIONS], where)
    kind = _kind(table, where)
    return ConfigFile(_config(kind, table, where), kind, hashlib.sha256(data).hexdigest())


HEAD = """\
# An Étude campaign. Edit it by hand; a key that is left out takes its preset's value, "none" switches off.
# Its hash is stored with every event, so the journal knows which version was in force.
# The robot and its limits are in robot.toml beside this file. Angles are rad, times s.

"""

COMMENTS: dict[str, dict[str, str]] = {
    "model": {
        "rung": '"gp", "linear", "identified", "identified+gp", ...; "auto": what predicts each command best',
        "choose_by": '"squared" or "absolute" held-out error decides',
        "replace": 'a structure replaces another if better by "chance", or on "every" held-out motion',
        "process_from": "logs from which processes compete with physics alone",
        "kernel": '"structured", or "ard_se", as the thesis; or a plug-in',
        "sharing": '"separate" processes of the commands, or one kernel "shared" by all',
        "process": '"exact", or another member of docs/models.md, "dictionary_variance" for example',
        "points": "samples each process is conditioned on, at most",
        "inducing": "of twice as many samples all teach, through so many; 0: points alone",
        "basis": "inducing, spectral or basis points, at most, of a process that has them",
        "fit_points": "of these, samples for hyperparameters, at most; of over 4 commands in proportion",
        "fit_spacing_s": "these are at least so many s apart",
        "candidates": "processes that are averaged for each output; docs/models.md says what each is worth",
        "steps": 'of the hyperparameter training; of "minimize" line searches (negative: evaluations)',
        "warm_from": "logs from which training goes on from the last model",
        "warm_steps": "of a training that goes on; 0: as many as steps",
        "method": '"lbfgs", "minimize": conjugate gradients, as the thesis, or "descent": fixed steps',
        "starts": "of the training; the best end wins",
        "schedule": 'hyperparameters from log to log: "update", "constant", "reinitialise" or "first"',
        "prior": '"weak" priors on the hyperparameters, or "none"',
        "noise_floor": 'least noise, a part of what floor_of says; or "auto"',
        "floor_of": '"limit" of the command, or "deviation" of what a process learns',
        "stretch_s": "s of what is held out of a single log",
        "calibrate": "widen variances that held-out trajectories show to be too small",
        "student_t": "fit the tails of held-out errors, for the reported density",
    },
    "design": {
        "first": 'the first trajectory: "designed" from the limits alone, or "random"',
        "reference": 'what stands in for tasks: "mixed", moves and slow series; or random ones, "family"',
        "criterion": '"log_ivr", "ivr" (at the tasks), "mean_variance" (thesis 3.2); more: docs/criteria.md',
        "sampler": 'random candidates: "scaled" to the limits, or "uniform" on what is allowed and its edge',
        "candidates": "certified random candidates that are scored",
        "refine": "how many of the best are refined",
        "steps": "iterations of each refinement",
        "points": "planned samples along a trajectory",
        "planned_noise": "planned samples stand for all that will be logged, each with less noise",
        "reference_points": "states per process at which the variance counts",
        "random_share": "part of these taken from what stands in although tasks are given",
        "inducing": "exact processes with more samples are seen through so many; 0: as they are",
        "raw_units": "add variances of different commands as they are, as the thesis",
    },
    "tracking": {
        "margin": 'kept of the limits for tracking errors: "learned" from logs, "assumed", or "none"',
        "position": "assumed before any log where gains are not known: part of each range",
        "velocity": "the same of each velocity limit",
        "most": "part of the distance from home to a position limit that a margin may take at most",
        "control": 'of motions that teach in simulate and run, from the second on: "learned" or "feedback"',
    },
    "stop": {
        "command_tolerance": "good enough: expected command error as a fraction of the command limit; 0: off",
        "noise_fraction": "stop when the variance left is below this fraction of the noise; 0: off",
        "gain_per_minute": "stop when less of the variance left goes per robot minute; 0: off",
        "setup_s": "s of robot time each trajectory costs besides its duration",
        "budget_trajectories": "logs; 0 for no limit",
        "budget_minutes": "minutes of recorded motion; 0 for no limit",
        "consecutive": "logs in a row that must agree before a rule stops the campaign",
    },
    "log": {
        "columns": 'other names: "q_shoulder [deg]" = "ActPos1", a line each; etude inspect --write-mapping',
        "ignored": "headers of columns to leave out",
        "topics": "of logs that hold several; none: those that look like what is needed",
        "rate": "Hz, at which rows of logs without a time column stand; 0: such logs are refused",
    },
}


def config_text(config: CampaignConfig, kind: Kind) -> str:
    """campaign.toml with every value written out and explained."""
    head = f'{HEAD}kind = "{config.kind}"\npreset = "{config.preset}"\nseed = {config.seed}\n'
    comments = {name: {**COMMENTS.get(name, {}), **kind.comments.get(name, {})} for name in SECTIONS}
    return "\n".join([head, *(write_table(n, getattr(config, n), comments[n]) for n in SECTIONS)])


def _kind(table: Mapping[str, Any], where: str) -> Kind:
    if "kind" not in table:
        raise UsageError(
            "campaign.toml names no kind of robot",
            where=where,
            next_step='Write its kind at the top: kind = "arm", for example.',
        )
    name = table["kind"]
    if not isinstance(name, str):
        raise UsageError(f"kind = {name!r} must be the name of a kind of robot", where=f"{where} kind")
    try:
        kind: Kind = plugins.load("etude.robots", name)
    except UsageError as error:
        raise UsageError(error.fact, where=f"{where} kind", next_step=error.next_step) from None
    return kind


def _config(kind: Kind, table: Mapping[str, Any], where: str) -> CampaignConfig:
    name, seed = table.get("preset", "default"), table.get("seed", 0)
    start = preset_config(kind, name, f"{where} preset") if isinstance(name, str) else None
    if start is None:
        raise UsageError(f"preset = {name!r} must be a name", where=f"{where} preset")
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise UsageError(f"seed = {seed!r} must be a whole number, 0 or more", where=f"{where} seed")
    parts = {section: _section(section, table, start, where) for section in SECTIONS}
    return replace(start, seed=seed, **parts)


def _section(name: str, table: Mapping[str, Any], start: Any, where: str) -> Any:
    value = getattr(start, name)
    return read_table(type(value), table.get(name, {}), value, f"{where} [{name}]")
