"""Runtime of a deployed folder in a controller's loop: commands that improve while the robot runs."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from etude import plugins
from etude._runtime.trusted_folders import names_in, require_trusted
from etude.errors import DataError, UsageError
from etude.models.config import ModelConfig
from etude.models.store import load_model
from etude.protocols import Kind
from etude.storage import write_atomic
from etude.types import Array, Motion, Row
from etude_online.guard_effort import command_limits
from etude_online.learner import OnlineConfig
from etude_online.learner_state import put_back, state_bytes, state_of, taken
from etude_online.memoized_mean import with_memoized_means
from etude_online.online_folder import HASHES, MODEL, ROBOT, SETTINGS, read_config, read_feedback
from etude_online.online_model import Counts, OnlineModel


class Deployed:
    """A model that goes on learning (implements `protocols.Controller`); `open_online` makes it.

    For one thread. A tick is `command`, then `observe`.

    Attributes:
        names: of the commands. rate: of the ticks, Hz. warm_s: what opening spent on warming up.
    """

    def __init__(self, online: OnlineModel, kind: Kind, spec: Any, digest: str) -> None:
        self._online, self._digest = online, digest
        self.names, self.rate = online.model.commands, float(spec.rate)
        self._home = kind.home(spec)
        self.warm_s = 0.0

    def planned_row(self, orders: Sequence[Array]) -> Row:
        """The row that `command` takes, of a planned instant: the path and its derivatives, (k,) each.

        Raises:
            UsageError: fewer derivatives than the model looks at, or another number of coordinates.
        """
        inputs = self._online.model.inputs
        shapes = {np.shape(order) for order in orders}
        if len(shapes) > 1:
            raise UsageError(
                f"the orders of a plan have different shapes: {', '.join(str(np.shape(o)) for o in orders)}",
                next_step=f"Give the path and each derivative as {len(self._home)} numbers.",
            )
        plan = np.array([np.asarray(order, dtype=float) for order in orders])
        if plan.shape[1:] != self._home.shape or len(plan) < inputs.orders:
            raise UsageError(
                f"a plan of shape {plan.shape}, not ({inputs.orders}, {len(self._home)})",
                next_step=f"Give the path and {inputs.orders - 1} derivatives.",
            )
        states = inputs.states(Motion(np.zeros(1), plan[: inputs.orders, None]))
        return {name: values[0] for name, values in states.values.items()}

    def planned(self, motion: Motion) -> Array | None:
        """Asks the trained model for a whole plan at once, for cheaper ticks; None: they still go on."""
        return self._online.planned(motion)

    def outside(self, motion: Motion) -> dict[str, float]:
        """The share of a plan's rows at which each command lies outside of what was trained
        (`models.trust.outside`): what `etude predict` says of it. For before a run, not for a tick.
        """
        model = self._online.model
        beyond = model.outside(model.inputs.states(motion))
        return dict(zip(self.names, beyond.mean(axis=0).tolist(), strict=True))

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        """The command (J,) for the planned row of time t in s, within its limits, and its deviation (J,).

        UsageError: the row lacks a channel that the model looks at, or one has another number of parts.
        """
        return self._online.command(t, row)

    def observe(self, t: float, row: Row) -> None:
        """What was measured in this tick, the applied command in it.

        UsageError: a channel has another number of parts, or is missing in the first row. One that is missing
        later is a measurement that was lost: it is not learned, and `reports` says so.
        """
        self._online.observe(t, row)

    def reports(self) -> list[tuple[float, str]]:
        """(s of its own clock, sentence) of the guard's reactions since the last call."""
        reactions = list(self._online.reports)
        self._online.reports.clear()
        return reactions

    def weights(self) -> dict[str, float]:
        """What part of each command comes from the model since."""
        return dict(zip(self.names, self._online.weights(), strict=True))

    @property
    def counts(self) -> Counts:
        """What became of the measurements."""
        return self._online.counts

    def save(self, path: str | Path) -> None:
        """Writes all that was learned, whole or not at all; not in a control tick: it takes some 0.1 s."""
        write_atomic(Path(path), state_bytes([self._digest, self._online.state()]))

    def restore(self, path: str | Path) -> None:
        """Goes on from what `save` wrote. DataError: damaged, or of another folder."""
        saved = state_of(_read(Path(path)))
        if not (isinstance(saved, list) and len(saved) == 2 and saved[0] == self._digest):
            raise DataError(
                "this was saved from another folder",
                where=str(path),
                next_step="Open without it, because the learned part belongs to another model.",
            )
        self._online.restore(saved[1])

    def warm(self) -> float:
        """Runs every part once and forgets it; returns the seconds. Opening has done so."""
        begun, online = time.perf_counter(), self._online
        orders = np.zeros((online.model.inputs.orders, len(self._home)))
        orders[0] = self._home
        before = taken(online)
        row = self.planned_row(list(orders))
        x, _ = online.model.inputs.step(row, None)
        for k in range(3):
            online.command(0.0, row)
            for command in online.commands:
                command.judge(float(k), x, 0.0, 0.0)
                command.learned(np.inf)
        put_back(online, before)
        online.reports.clear()
        self.warm_s = time.perf_counter() - begun
        return self.warm_s


TRUST = "etude_online.runtime.open_online({folder!r}, trust=True)"
"""What opens a folder that names code of others."""


def open_online(folder: str | Path, state: str | Path | None = None, *, trust: bool = False) -> Deployed:
    """Opens a folder that was exported for learning on line, warm.

    Args:
        folder: as exported. state: what `Deployed.save` wrote, to go on from; None begins with the model.
        trust: run code that its files name as module:attribute, of a kernel of your own for example.

    Raises:
        UsageError: no such folder, its kind of robot is not installed, or it names code and is not trusted.
        DataError: a file is missing, was changed, or is of another version.
    """
    folder = Path(folder)
    digest = _verified(folder)
    stored, settings = json.loads(_read(folder / SETTINGS)), folder / SETTINGS
    if trust:
        return _opened(folder, stored, digest, state)
    command = TRUST.format(folder=str(folder))
    require_trusted(names_in([stored["kind"], stored["config"]]), settings, folder, digest, command)
    with plugins.named_in(settings, folder, digest, command):
        return _opened(folder, stored, digest, state)


def _opened(folder: Path, stored: Mapping[str, Any], digest: str, state: str | Path | None) -> Deployed:
    kind: Kind = plugins.load("etude.robots", stored["kind"])
    spec = kind.spec(folder / ROBOT / "robot.toml")
    config = read_config(stored["config"], {**kind.tables, "model": ModelConfig})
    inputs, physics = kind.inputs(spec, config), kind.physics(spec, config)
    model = with_memoized_means(load_model(folder / MODEL, inputs.restore, physics))
    online = OnlineModel(
        model,
        kind.channels(spec),
        kind.controller(spec, config, model),
        command_limits(kind, spec),
        OnlineConfig(**stored["learning"]),
        spec.rate,
        np.random.default_rng(stored["seed"]),
        read_feedback(stored["feedback"]),
    )
    deployed = Deployed(online, kind, spec, digest)
    deployed.warm()
    if state is not None:
        deployed.restore(state)
    return deployed


def _verified(folder: Path) -> str:
    """SHA-256 of the list of hashes, each of which holds."""
    if not (folder / HASHES).is_file():
        raise UsageError(
            "not a folder of a model with online learning",
            where=str(folder),
            next_step="Write one: etude export LAB --to online.",
        )
    data = _read(folder / HASHES)
    try:
        hashes: Mapping[str, str] = json.loads(data)["files"]
        changed = [n for n, h in hashes.items() if hashlib.sha256(_read(folder / n)).hexdigest() != h]
        missing = [name for name in (MODEL, SETTINGS) if name not in hashes]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(
            f"the list of hashes is damaged ({error})",
            where=str(folder / HASHES),
            next_step="Export the folder again: etude export FOLDER --to online.",
        ) from error
    if changed or missing:
        raise DataError(
            f"{', '.join([*changed, *missing])} was changed since the export",
            where=str(folder),
            next_step="Do not run it; export it again.",
        )
    return hashlib.sha256(data).hexdigest()


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DataError(
            f"could not read: {error.strerror or error}", where=str(path), next_step="Export it again."
        ) from error
