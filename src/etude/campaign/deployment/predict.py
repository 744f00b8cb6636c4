"""predict: commands of a model along a planned or recorded motion, as a table."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from etude.campaign.deployment.motion_files import is_path_alone, is_plan, motion_of_table
from etude.campaign.record.deployed_model import deployed_model
from etude.campaign.record.folder import Campaign, Say, open_campaign
from etude.errors import DataError, UsageError
from etude.logs.cleaning.read import matched_log
from etude.logs.readers.cells import header_row
from etude.models.data.as_log import followed
from etude.models.learned_model import LearnedModel
from etude.protocols import Trajectory
from etude.storage import write_atomic
from etude.trajectories.json_text import from_json
from etude.types import Array, Channel, Log, Mask

COMMAND, DEVIATION, OUTSIDE, SINGLE = "command", "deviation", "outside", "row_deviation"
ROUNDED = 1e-3
"""Part of a range that noise and rounded digits of a table may lie outside of it."""
EVERY_ROW = {"rate_hz": 1e6, "lag_s": 0.0}
"""Overrides of keys of [data]: learning drops rows and shifts commands, while prediction needs every row."""


def predict(
    campaign: Campaign | str | Path,
    motion: str | Path | Log,
    *,
    degrees: bool = False,
    say: Say = lambda _: None,
) -> Log:
    """Commands along a motion: channels "command", "deviation", "row_deviation" and "outside", each (T, J).
    "outside" is 1 where the row lies outside of the command's training data (`LearnedModel.outside`);
    `repairs` has a sentence on its frequency.

    "deviation" is the standard deviation of a training sample, noise included: commands there are filtered or
    averaged to the model's rate. "row_deviation" is that of a single recorded row, with the larger scatter of
    the newest log; models of earlier versions have the same value for both.

    Args:
        campaign: the folder, or it opened.
        motion: a trajectory.json; a log; or a table with a time and the robot's columns, named as logs are.
            Missing velocities or accelerations are derived from the positions as in training; existing ones
            are used unchanged, and times stay those of the table.
        degrees: the table's angles are degrees.
        say: receives the sentence on the model.

    Raises:
        UsageError: nothing learned yet, or no such file. DataError: it is no motion of this robot.
    """
    campaign = campaign if isinstance(campaign, Campaign) else open_campaign(Path(campaign))
    used = deployed_model(campaign)
    say(used.sentence)
    model, trained = used.model, campaign.round(used.number).trained
    scatter = np.array(trained.row_scatter if trained and trained.row_scatter else 0.0)
    if not isinstance(motion, Log):
        place = Path(motion)
        if not place.exists():
            raise UsageError("there is no such motion", where=str(place), next_step="Check the path.")
        if is_plan(campaign, place):
            say(f"{place.name} is the table of {place.stem}.json, so the motion of that file is used.")
            place = place.with_suffix(".json")
        if place.suffix == ".json":
            return _along(campaign, model, _planned(campaign, place), scatter)
        if is_path_alone(campaign, place):
            say(f"{place.name} holds only a path: the commands are those of the motion planned along it.")
            return _along(campaign, model, motion_of_table(campaign, place), scatter)
        motion = _read(campaign, place, degrees)
        try:
            return _in_units(model, states_for(campaign, model, motion), campaign, scatter)
        except DataError as error:  # its advice is for training, not for such a table
            raise DataError(error.fact, where=str(place), next_step=_missing_state_advice(place)) from error
    return _in_units(model, states_for(campaign, model, motion), campaign, scatter)


def _along(campaign: Campaign, model: LearnedModel, motion: Trajectory, scatter: Array) -> Log:
    states = model.planned(motion, rate=float(campaign.spec.rate))
    return _in_units(model, states, campaign, scatter)


def _missing_state_advice(place: Path) -> str:
    """Advice for a table that lacks a state that the model needs."""
    planned = place.with_suffix(".json")
    instead = f"{planned.name} beside it" if planned.is_file() else "the trajectory.json of the motion"
    return f"Add velocities and accelerations, named as in logs. Or name {instead}, or a longer motion."


def states_for(campaign: Campaign, model: LearnedModel, motion: Log) -> Log:
    """The log if it has the model's input channels, else the states that the recipe derives from it; with the
    memory of the physics.

    Raises:
        DataError: neither is possible.
    """
    channels = dict.fromkeys(channel for channel, *_ in model.columns)
    missing = [name for name in channels if name not in motion]
    return _as_learning(campaign, motion, missing) if missing else followed(model.inputs, motion)


def _as_learning(campaign: Campaign, motion: Log, missing: Sequence[str]) -> Log:
    """The states that the kind's recipe derives from the log, at all rows within reach of the filter."""
    data: Any = campaign.config.data
    settings = {name: value for name, value in EVERY_ROW.items() if hasattr(data, name)}
    config = replace(campaign.config, data=replace(data, **settings))
    if campaign.command.name not in motion:
        ramp = np.linspace(0.0, 1.0, len(motion))  # recipes need commands, but no state depends on them
        parts = len(campaign.command.parts)
        motion = motion.put(campaign.command, np.tile(ramp[:, None], (1, parts)))
    groups = [np.zeros(len(motion), dtype=np.int64)]
    samples = campaign.kind.samples(campaign.spec, config, [motion], groups)
    note = (
        f"{' and '.join(missing)} computed from the positions by the filter of training, which cuts the ends."
    )
    derived = _with_recorded_rates(motion, samples.log, missing)
    repairs = [sentence for sentence in motion.repairs if sentence not in derived.repairs]
    return derived.repaired(*repairs, note[0].upper() + note[1:])


def _with_recorded_rates(motion: Log, made: Log, missing: Sequence[str]) -> Log:
    """The derived states, with the rates of the motion where it has them."""
    rows = np.searchsorted(motion.t, made.t).clip(0, len(motion) - 1)
    if not np.array_equal(motion.t[rows], made.t):
        return made
    for name, channel in motion.channels.items():
        if channel.derivative_of and name in made and name not in missing:
            made = made.put(channel, motion[name][rows])
    return made


def _planned(campaign: Campaign, place: Path) -> Trajectory:
    """The motion of a trajectory.json. UsageError: it is none. DataError: it is another robot's."""
    try:
        motion = from_json(place.read_bytes())
    except UsageError as error:
        step = "Name a trajectory.json of etude ask, or a table with a time and the robot's columns."
        raise UsageError(error.fact, where=str(place), next_step=step) from None
    axes, expected = motion.motion(np.zeros(1), 1).orders[0].shape[1], len(campaign.axes)
    if axes != expected:
        raise DataError(
            f"the motion has {axes} axes, and {campaign.name} has {expected}",
            where=str(place),
            next_step="Name a motion of this robot, or the campaign of the motion's robot.",
        )
    return motion


def _read(campaign: Campaign, path: Path, degrees: bool) -> Log:
    from etude.logs.cleaning.repairs import drop_unreadable, order_rows
    from etude.logs.columns.units import from_degrees

    loose = [
        replace(c, required=c.name == campaign.kind.path) if c.role == "command" else c
        for c in campaign.channels
    ]
    rate = campaign.kind.expected(campaign.spec).rate
    log, stated = matched_log(path, loose, rate, (), campaign.config.log)
    log = from_degrees(log, stated) if degrees else log
    return order_rows(drop_unreadable(log, recorded=False))


def _in_units(model: LearnedModel, states: Log, campaign: Campaign, scatter: Array) -> Log:
    """The model's prediction, with the robot's own channel of commands, so that their unit is known.

    scatter: (J,) or a number, deviation of single rows from the filtered commands.
    """
    prediction = model.commanded(states)
    aside = replace(campaign.command, name=DEVIATION, role="aside")
    beyond = Channel(OUTSIDE, campaign.command.parts, ("1",) * len(campaign.command.parts), "aside")
    prediction = replace(prediction, channels={COMMAND: campaign.command, DEVIATION: aside, OUTSIDE: beyond})
    prediction = prediction.put(replace(aside, name=SINGLE), np.hypot(prediction[DEVIATION], scatter))
    return prediction.repaired(
        *_illegal(campaign, states), *_outside_sentence(model, prediction[OUTSIDE] > 0.0)
    )


def _illegal(campaign: Campaign, states: Log) -> list[str]:
    """A sentence on states beyond the robot's limits, which no motion may have."""
    violations = []
    for name, (lower, upper) in campaign.kind.expected(campaign.spec).limits.items():
        channel = states.channels.get(name)
        if channel is None or channel.role == "command" or states[name].shape[1:] != lower.shape:
            continue
        low, high, edge = states[name].min(axis=0), states[name].max(axis=0), ROUNDED * (upper - lower)
        violations += [
            f"{channel.parts[j]} {name} {low[j]:.3g} to {high[j]:.3g} of {lower[j]:.3g} to {upper[j]:.3g}"
            for j in np.flatnonzero((low < lower - edge) | (high > upper + edge)).tolist()
        ]
    return [f"These states are beyond the robot's limits: {', '.join(violations)}."] if violations else []


def _outside_sentence(model: LearnedModel, beyond: Mask) -> list[str]:
    """A sentence with the share of rows of each command that lie outside, if some do."""
    shares = 100.0 * beyond.mean(axis=0)
    if not beyond.any():
        return []
    texts = [
        f"{name} {share:.3g} %" for name, share in zip(model.commands, shares, strict=True) if share > 0.0
    ]
    return [
        f"Rows outside the training data: {', '.join(texts)}. Their deviation is more than twice that of "
        "training. Where nothing is known, the command is physics alone, or a constant without physics."
    ]


def check_table(path: Path) -> None:
    """UsageError: commands are not written in files that end so."""
    if path.suffix not in (".csv", ".parquet"):
        step = f"Name it {path.with_suffix('.csv').name}, for example."
        raise UsageError("commands are written as .csv or .parquet", where=str(path), next_step=step)


def write_table(path: Path, prediction: Log) -> None:
    """Commands with deviations as CSV, every number in full, or as Parquet, by the suffix.

    Raises:
        UsageError: another suffix.
    """
    check_table(path)
    if path.suffix == ".parquet":
        import polars as pl

        buffer = io.BytesIO()
        pl.DataFrame(_columns(prediction)).write_parquet(buffer)
        write_atomic(path, buffer.getvalue())
        return
    columns = _columns(prediction)
    rows = np.column_stack([*columns.values()]).tolist()
    lines = [header_row(columns).rstrip(), *(",".join(map(repr, row)) for row in rows)]
    write_atomic(path, ("\n".join(lines) + "\n").encode())


def _columns(prediction: Log) -> dict[str, Array]:
    columns = {"time": prediction.t}
    for name in (name for name in (COMMAND, DEVIATION, SINGLE, OUTSIDE) if name in prediction):
        channel: Channel = prediction.channels[name]
        columns |= {f"{name}_{part}": prediction[name][:, j] for j, part in enumerate(channel.parts)}
    if not np.isfinite(np.column_stack([*columns.values()])).all():
        raise DataError(
            "the model's prediction is not finite", next_step="Do not run this. Train the model again."
        )
    return columns
