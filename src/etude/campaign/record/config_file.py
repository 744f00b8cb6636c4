"""Configuration file of a campaign: campaign.toml, which people edit by hand."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from etude import plugins
from etude._runtime.trusted_folders import (
    folder_id,
    is_trusted,
    names_in,
    require_no_links_out,
    require_trusted,
    trust,
)
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
        UsageError: the folder holds no campaign, a value is invalid (names the file and the key), or the
            folder is not trusted and names code or has a link out of it.
    """
    path = folder / CONFIG
    try:
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise UsageError(
            "there is no campaign here",
            where=str(path),
            next_step="Create one: etude init FOLDER --robot NAME.",
        ) from None
    except OSError as error:
        raise unreadable(path, error) from error
    require_trusted_names(folder, CONFIG, _names(data, str(path)))
    require_no_links_out(folder, folder_id(folder / JOURNAL), trust_command(folder))
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
# An Étude campaign. Edit it by hand; a missing key has the value of the preset, "none" switches off.
# The journal stores the hash of this file with every event, and so the version that was used.
# The robot and its limits are in robot.toml beside this file. Angles are rad, times s.

"""

COMMENTS: dict[str, dict[str, str]] = {
    "model": {
        "rung": '"gp", "linear", "identified", "identified+gp", ...; "auto": the best structure for each '
        "command",
        "choose_by": 'error that cross-validation compares: "squared" or "absolute"',
        "replace": 'a structure replaces another if significantly better ("chance"), or better on "every" '
        "held-out motion",
        "process_from": "number of logs from which processes are compared with physics alone",
        "kernel": '"structured", or "ard_se", as the thesis; or a plug-in',
        "sharing": '"separate" processes of the commands, or one kernel "shared" by all',
        "process": '"exact", or another member of docs/models.md, "dictionary_variance" for example',
        "points": "largest number of samples of each process",
        "inducing": "from twice as many samples, all are used through so many points; 0: a subset",
        "basis": "largest number of inducing, spectral or basis points, in members that have them",
        "fit_points": "largest number of samples for hyperparameters; scaled for more than 4 commands",
        "fit_spacing_s": "least time between these samples in s",
        "candidates": "ensemble members averaged for each output; docs/models.md compares them",
        "steps": 'iterations of the hyperparameter training; of "minimize" line searches (negative: '
        "evaluations)",
        "warm_from": "number of logs from which training starts from the last model",
        "warm_steps": "iterations when training starts from the last model; 0: as many as steps",
        "method": '"lbfgs", "minimize": conjugate gradients, as the thesis, or "descent": fixed steps',
        "starts": "starts of the training; the best result is used",
        "schedule": 'hyperparameters from log to log: "update", "constant", "reinitialise" or "first"',
        "prior": '"weak" priors on the hyperparameters, or "none"',
        "noise_floor": 'least noise as a fraction of floor_of; or "auto"',
        "floor_of": '"limit" of the command, or "deviation" of the training targets',
        "stretch_s": "length in s of the held-out blocks of a single log",
        "calibrate": "enlarge variances that held-out trajectories show to be too small",
        "student_t": "fit the tails of held-out errors, for the reported density",
    },
    "design": {
        "first": 'the first trajectory: "designed" from the limits alone, or "random"',
        "reference": 'substitute for tasks: "mixed" (moves and slow series) or "family" (random)',
        "criterion": '"log_ivr", "ivr" (at the tasks), "mean_variance" (thesis 3.2); more: docs/criteria.md',
        "sampler": 'random candidates: "scaled" to the limits, or "uniform" inside the limits and on them',
        "candidates": "number of certified random candidates",
        "refine": "number of the best candidates that are refined",
        "steps": "iterations of each refinement",
        "points": "planned samples along a trajectory",
        "planned_noise": "planned samples represent all logged samples, with less noise each",
        "reference_points": "states per process at which the variance is evaluated",
        "random_share": "fraction of these from the substitute although tasks are given",
        "inducing": "exact processes with more samples are approximated with so many; 0: never",
        "raw_units": "add variances of different commands without scaling, as in the thesis",
    },
    "tracking": {
        "margin": 'tracking margins inside the limits: "learned" from logs, "assumed", or "none"',
        "position": "assumed before any log if gains are unknown: fraction of each range",
        "velocity": "assumed likewise: fraction of each velocity limit",
        "most": "largest margin as a fraction of the distance from home to a position limit",
        "control": 'control of training motions in simulate and run, from the second on: "learned" or '
        '"feedback"',
    },
    "stop": {
        "command_tolerance": "goal: expected command error as a fraction of the command limit; 0: off",
        "noise_fraction": "stop when the remaining variance is below this fraction of the noise; 0: off",
        "gain_per_minute": "stop when a smaller fraction of the remaining variance is removed per robot "
        "minute; 0: off",
        "setup_s": "robot time of each trajectory besides its duration, in s",
        "budget_trajectories": "largest number of logs; 0 for no limit",
        "budget_minutes": "largest recorded motion in minutes; 0 for no limit",
        "consecutive": "number of successive logs that must agree before a rule stops the campaign",
    },
    "log": {
        "columns": 'other names: "q_shoulder [deg]" = "ActPos1", a line each; etude inspect --write-mapping',
        "ignored": "headers of columns to ignore",
        "topics": "topics to read, of logs with several; none: the topics that fit",
        "rate": "rate in Hz of logs without a time column; 0: such logs are refused",
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
            "campaign.toml does not state the kind of robot",
            where=where,
            next_step='Write it at the top, for example: kind = "arm".',
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
