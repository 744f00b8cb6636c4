"""A campaign folder as `etude simulate` leaves it, written from formulas so that every number is known."""

from __future__ import annotations

import base64
import json
import struct
import zlib
from pathlib import Path

import numpy as np

from etude.campaign import config_text, preset_config
from etude.limits import FeasibleSet, certify, uniform
from etude.logs import write_log
from etude.storage import write_atomic
from etude.trajectories import FourierConfig, FourierFamily, FourierTrajectory
from etude.types import Log
from etude_arm import KIND, ArmInputs, ArmSpec, Axis
from journal_facts import commit

SECONDS = 20.0
CONFIG = "0" * 64
BASELINES = {"pd": 3.2, "rigid_body": 0.98, "perfect": 0.11}
JOINTS = np.array([1.3, 0.9, 0.7, 1.1])
DEFAULT = preset_config(KIND, "default")


def spec(names: tuple[str, ...] = ("waist", "shoulder", "elbow", "wrist")) -> ArmSpec:
    """A robot with the given joint names."""
    axes = tuple(Axis(name, -1.0 - 0.1 * j, 0.8, 0.5, 1.5, 255.0) for j, name in enumerate(names))
    return ArmSpec("synthetic <arm>", axes, "pwm", 50.0)


def error_after(number: int) -> float:
    """Mean tracking error in degrees after `number` rounds."""
    return 0.12 + 2.0 * 0.35**number


def write_campaign(
    folder: Path, rounds: int = 5, *, evaluated: bool = True, robot: ArmSpec | None = None
) -> ArmSpec:
    """A campaign with `rounds` learned logs and one more trajectory asked for."""
    robot = robot or spec()
    rng = np.random.default_rng(7)
    write_robot(folder, robot)
    write_atomic(folder / "campaign.toml", config_text(DEFAULT, KIND).encode())
    commit(folder, "created", None, CONFIG, [], seed=3)
    if evaluated:
        _evaluate_baselines(folder, robot.dof)
    for number in range(1, rounds + 2):
        trajectory = proposed(folder, robot, number, 70 + number)
        if number <= rounds:
            told(folder, robot, trajectory, number, rng)
            _train(folder, robot.dof, number, rng)
            if evaluated:
                _evaluate(folder, robot.dof, number)
    return robot


def write_robot(folder: Path, robot: ArmSpec) -> None:
    lines = [f'name = "{robot.name}"', f'command_unit = "{robot.command_unit}"', f"rate = {robot.rate}"]
    for axis in robot.axes:
        lines += ["[[axis]]", f"name = {json.dumps(axis.name)}"]
        lines += [
            f"{key} = {getattr(axis, key)}"
            for key in ("lower", "upper", "velocity", "acceleration", "command")
        ]
    write_atomic(folder / "robot.toml", "\n".join([*lines, ""]).encode())


DRAWN: dict[tuple[str, int], tuple[FourierTrajectory, str]] = {}


def drawn(robot: ArmSpec, seed: int) -> tuple[FourierTrajectory, str]:
    """A trajectory and its certificate, the same in every campaign of the robot."""
    key = (repr(robot), seed)
    if key not in DRAWN:
        limits = KIND.limits(robot, DEFAULT, None, {})
        family = FourierFamily.of(FourierConfig(duration=SECONDS), robot.dof)
        feasible = FeasibleSet.of(limits, family, KIND.home(robot))
        trajectory = family.trajectory(uniform(np.random.default_rng(seed), feasible)[0])
        DRAWN[key] = trajectory, certify(trajectory, limits).to_json()
    return DRAWN[key]


def proposed(folder: Path, robot: ArmSpec, number: int, seed: int) -> FourierTrajectory:
    """A trajectory with its certificate, asked for and committed."""
    trajectory, certificate = drawn(robot, seed)
    place = folder / "proposals" / f"{number:04d}"
    write_atomic(place / "trajectory.json", trajectory.to_json().encode())
    write_atomic(place / "certificate.json", certificate.encode())
    files = [place / "trajectory.json", place / "certificate.json"]
    commit(folder, "asked", number, CONFIG, files, status="converged", seconds=1.2)
    return trajectory


def synthetic_log(
    robot: ArmSpec, trajectory: FourierTrajectory, error_deg: float, rng: np.random.Generator
) -> Log:
    """A run whose tracking error is a sine of known size, with 1 s of lead-in."""
    t = np.arange(-1.0, trajectory.duration, 1.0 / robot.rate)
    q, qd, qdd = trajectory.motion(np.maximum(t, 0.0)).orders
    moving = (t >= 0.0)[:, None]
    true = q - np.radians(error_deg) * np.sin(3.0 * t)[:, None] * moving
    wanted = 300.0 * np.tanh(qd / 0.02) * 0.2 + 250.0 * qd + 40.0 * np.sin(q)
    feedback = 400.0 * (q - true)
    values = {
        "q": true + 2e-4 * rng.standard_normal(true.shape),
        "command": np.clip(np.round(wanted + feedback), -255, 255),
        "q_des": q,
        "qd_des": qd,
        "qdd_des": qdd,
        "command_ff": wanted * 0.95,
        "command_fb": feedback,
        "q_true": true,
    }
    channels = {c.name: c for c in robot.channels() if c.name in values}
    return Log(t, channels, values, "synthetic", ("dropped 3 repeated samples",))


def told(
    folder: Path, robot: ArmSpec, trajectory: FourierTrajectory, number: int, rng: np.random.Generator
) -> None:
    """The log of a motion, committed."""
    log = synthetic_log(robot, trajectory, error_after(number - 1), rng)
    path = folder / "runs" / f"{number:04d}.parquet"
    write_log(path, log)
    facts = {"sha256": f"{number:064d}", "robot_seconds": SECONDS, "repairs": list(log.repairs)}
    commit(folder, "told", number, CONFIG, [path], **facts)


def _train(folder: Path, dof: int, number: int, rng: np.random.Generator) -> None:
    models = {
        kind: {
            "nmse": [scale * (0.02 + 0.6 * 0.5**number) * (1 + 0.2 * j) for j in range(dof)],
            "z2": [float(x) for x in (1.0 + 8.0 * 0.4**number) * rng.uniform(0.7, 1.3, dof)],
            "coverage": [float(x) for x in 0.95 - 0.3 * 0.5**number * rng.uniform(0.5, 1.0, dof)],
        }
        for kind, scale in {"linear": 3.0, "identified": 1.6, "gp": 1.2, "identified+gp": 0.8}.items()
    }
    scores = models if number > 1 else {}
    commit(
        folder,
        "trained",
        number,
        CONFIG,
        [],
        models=scores,
        chosen="identified+gp",
        predicted_by="identified+gp" if number > 1 else None,
        robot_seconds=SECONDS * number,
    )


def _evaluate_baselines(folder: Path, dof: int) -> None:
    for test, scale in {"fourier": 1.0, "moves": 1.7}.items():
        for name, error in BASELINES.items():
            commit(folder, "evaluated", 0, CONFIG, [], baseline=name, test=test, robot_seconds=0.0,
                   tracking_error_deg=_per_joint(error * scale, dof))  # fmt: skip


def _evaluate(folder: Path, dof: int, number: int) -> None:
    for test, scale in {"fourier": 1.0, "moves": 1.7}.items():
        commit(folder, "evaluated", number, CONFIG, [], test=test, robot_seconds=SECONDS * number,
               tracking_error_deg=_per_joint(error_after(number) * scale, dof))  # fmt: skip


def _per_joint(mean: float, dof: int) -> list[float]:
    weight = np.resize(JOINTS, dof)
    return [float(x) for x in mean * weight / weight.mean()]


class BumpModel:
    """Stands in for a trained model: sure near the origin, unsure far from it."""

    def __init__(self, robot: ArmSpec) -> None:
        self.robot = robot
        self.inputs = ArmInputs.of(robot, 0.02)

    def posterior(self, log: Log) -> tuple[np.ndarray, np.ndarray]:
        return self.predict(log)

    def predict(self, log: Log) -> tuple[np.ndarray, np.ndarray]:
        far = (log["q"] / self.robot.upper) ** 2 + (log["qd"] / self.robot.velocity) ** 2
        return np.zeros_like(log["q"]), 4.0 + 900.0 * (1.0 - np.exp(-far))


def decode_png(text: str) -> np.ndarray:
    """Pixels (rows, columns, 3) of an unfiltered RGB PNG in base64; checks its signature and checksums."""
    data, chunks, at = base64.b64decode(text), {}, 8
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        assert struct.unpack(">I", data[at + 8 + length : at + 12 + length])[0] == zlib.crc32(kind + body)
        chunks[kind], at = body, at + 12 + length
    columns, rows = struct.unpack(">II", chunks[b"IHDR"][:8])
    scanlines = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(rows, 1 + 3 * columns)
    assert not scanlines[:, 0].any()
    return scanlines[:, 1:].reshape(rows, columns, 3)
