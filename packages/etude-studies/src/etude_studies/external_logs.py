"""Readers of two recordings that are not part of the project, as they are passed around: Panda and SARCOS."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from etude.errors import DataError
from etude.logs import clean_log
from etude.types import Array, Log, Samples
from etude_arm import ArmSpec, Axis
from etude_studies.world import World

JOINTS = 7
PANDA_COMMAND = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)
"""N m, the maker's joint torque limits (Franka Emika, control parameters of the Panda)."""
SARCOS_STEP_S = 0.1
"""About the time between two rows of the decimated set; nothing but the spacing of samples rests on it."""
MARGIN = 1.1
"""Where no limits are published, those of the recording times this."""


def panda_log(path: Path) -> tuple[Log, World]:
    """The log in an .npz with t (T,) s, q and tau (T, 7) rad and N m, and a robot with the log's limits.

    Raises:
        DataError: not such a file.
    """
    arrays = _npz(path, ("t", "q", "tau"))
    t, q, tau = arrays["t"], arrays["q"], arrays["tau"]
    _check(path, t=(t, (len(t),)), q=(q, (len(t), JOINTS)), tau=(tau, (len(t), JOINTS)))
    _check_time(path, t)
    speed = np.abs(arrays["qd"]).max(axis=0) if "qd" in arrays else np.full(JOINTS, 2.0)
    rate = float(1.0 / np.median(np.diff(t)))
    world = World.described("arm", _spec("panda", q, speed, np.array(PANDA_COMMAND), rate))
    channels = world.kind.channels(world.spec)
    log = _log(world, t, {"q": q, "command": tau}, path.name)
    return clean_log(log, channels, world.kind.expected(world.spec).limits), world


def sarcos_samples(path: Path) -> tuple[World, Samples]:
    """Samples of sarcos_inv_test in their order: .npz with q, qd, qdd, tau (n, 7), or the .mat (n, 28).

    They are used as they are: filtered by whoever recorded them, without time.

    Raises:
        DataError: not such a file.
    """
    parts = _sarcos_arrays(path)
    shape = (len(parts["q"]), JOINTS)
    for name, array in parts.items():
        _check(path, **{name: (array, shape)})
    speed = np.abs(parts["qd"]).max(axis=0)
    command = MARGIN * np.abs(parts["tau"]).max(axis=0)
    world = World.described("arm", _spec("sarcos", parts["q"], speed, command, 1.0 / SARCOS_STEP_S))
    moving = np.abs(parts["qd"]) >= world.config.data.stick_fraction * speed
    t = np.asarray(SARCOS_STEP_S * np.arange(shape[0]), dtype=np.float64)
    values = {"command" if name == "tau" else name: array for name, array in parts.items()}
    log = _log(world, t, values, path.name)
    return world, Samples(log, np.zeros(shape[0], dtype=np.int64), np.ones_like(moving), moving)


def _log(world: World, t: Array, values: Mapping[str, Array], source: str) -> Log:
    channels = {channel.name: channel for channel in world.kind.channels(world.spec)}
    return Log(t, {name: channels[name] for name in values}, values, source)


def _sarcos_arrays(path: Path) -> Mapping[str, Array]:
    names = ("q", "qd", "qdd", "tau")
    if path.suffix == ".npz":
        arrays = _npz(path, names)
        return {name: np.asarray(arrays[name], dtype=np.float64) for name in names}
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        table = loadmat(io.BytesIO(path.read_bytes()))["sarcos_inv_test"]
    except (OSError, ValueError, LookupError, NotImplementedError, TypeError, MatReadError) as error:
        raise _unreadable(path, error) from error
    _check(path, sarcos_inv_test=(table, (len(table), 4 * JOINTS)))
    return dict(zip(names, np.split(np.asarray(table, dtype=float), 4, axis=1), strict=True))


def _npz(path: Path, names: tuple[str, ...]) -> Mapping[str, Array]:
    try:
        # from memory: NumPy leaves a damaged file open
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise _unreadable(path, error) from error
    missing = [name for name in names if name not in arrays]
    if missing:
        raise DataError(
            f"there is no array {', '.join(missing)}",
            where=path.name,
            next_step=f"The file needs the arrays {', '.join(names)}; docs/real_logs.md describes it.",
        )
    return arrays


def _check(path: Path, **arrays: tuple[Array, tuple[int, ...]]) -> None:
    for name, (array, shape) in arrays.items():
        if array.shape != shape or not np.issubdtype(array.dtype, np.floating):
            raise DataError(
                f"array {name} is {array.dtype} of shape {array.shape}, not numbers of shape {shape}",
                where=path.name,
                next_step="docs/real_logs.md describes the file.",
            )
        bad = int(np.count_nonzero(~np.isfinite(array)))
        if bad:
            raise DataError(
                f"array {name} has {bad} entries that are no numbers",
                where=path.name,
                next_step="Was the file cut or edited? Fetch it again.",
            )


def _check_time(path: Path, t: Array) -> None:
    if len(t) < 2 or np.any(np.diff(t) <= 0):
        raise DataError(
            "time does not increase", where=f"{path.name}, array t", next_step="Fetch the file again."
        )


def _spec(name: str, q: Array, speed: Array, command: Array, rate: float) -> ArmSpec:
    axes = tuple(
        Axis(
            f"joint_{j + 1}",
            float(q[:, j].min() - 0.05),
            float(q[:, j].max() + 0.05),
            MARGIN * float(speed[j]),
            MARGIN * 5.0 * float(speed[j]),
            float(command[j]),
        )
        for j in range(JOINTS)
    )
    return ArmSpec(name, axes, "N m", rate)


def _unreadable(path: Path, error: Exception) -> DataError:
    return DataError(
        f"this file cannot be read ({error})", where=path.name, next_step="Fetch it again; is it whole?"
    )
