"""A campaign folder as `etude simulate` leaves it, written from formulas so that every number is known."""

from __future__ import annotations

import base64
import struct
import zlib
from pathlib import Path

import numpy as np

from etude.campaign.config_file import config_text
from etude.campaign.journal import commit
from etude.campaign.presets import preset
from etude.logs.log import RobotLog
from etude.logs.parquet import write_parquet
from etude.robots.spec import Axis, RobotSpec
from etude.storage import write_atomic
from etude.trajectories.certificate import certify
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.random import random_trajectory

SECONDS = 20.0
CONFIG = "0" * 64
BASELINES = {"pd": 3.2, "rigid_body": 0.98, "perfect": 0.11}
JOINTS = np.array([1.3, 0.9, 0.7, 1.1])


def spec(names: tuple[str, ...] = ("waist", "shoulder", "elbow", "wrist")) -> RobotSpec:
    """A robot with the given joint names."""
    axes = tuple(Axis(name, -1.0 - 0.1 * j, 0.8, 0.5, 1.5, 255.0) for j, name in enumerate(names))
    return RobotSpec("synthetic <arm>", axes, "pwm", 50.0)


def error_after(number: int) -> float:
    """Mean tracking error in degrees after `number` rounds."""
    return 0.12 + 2.0 * 0.35**number


def write_campaign(
    folder: Path, rounds: int = 5, *, evaluated: bool = True, robot: RobotSpec | None = None
) -> RobotSpec:
    """A campaign with `rounds` learned logs and one more trajectory asked for."""
    robot = robot or spec()
    rng = np.random.default_rng(7)
    write_robot(folder, robot)
    write_atomic(folder / "campaign.toml", config_text(preset("default")).encode())
    commit(folder, "created", None, CONFIG, [], seed=3, etude_version="0.1.0")
    if evaluated:
        _evaluate_baselines(folder, robot.dof)
    for number in range(1, rounds + 2):
        trajectory = _ask(folder, robot, number, rng)
        if number <= rounds:
            _tell(folder, robot, trajectory, number, rng)
            _train(folder, robot.dof, number, rng)
            if evaluated:
                _evaluate(folder, robot.dof, number)
    return robot


def write_robot(folder: Path, robot: RobotSpec) -> None:
    lines = [f'name = "{robot.name}"', f'command_unit = "{robot.command_unit}"', f"rate = {robot.rate}"]
    for axis in robot.axes:
        lines += ["[[axis]]", f'name = "{axis.name}"']
        lines += [
            f"{key} = {getattr(axis, key)}"
            for key in ("lower", "upper", "velocity", "acceleration", "command")
        ]
    write_atomic(folder / "robot.toml", "\n".join([*lines, ""]).encode())


def _ask(folder: Path, robot: RobotSpec, number: int, rng: np.random.Generator) -> FourierTrajectory:
    trajectory = random_trajectory(rng, robot, TrajectoryFamily(duration=SECONDS))
    place = folder / "proposals" / f"{number:04d}"
    write_atomic(place / "trajectory.json", trajectory.to_json().encode())
    write_atomic(place / "certificate.json", certify(trajectory, robot).to_json().encode())
    files = [place / "trajectory.json", place / "certificate.json"]
    commit(folder, "asked", number, CONFIG, files, status="converged", seconds=1.2)
    return trajectory


def synthetic_log(
    robot: RobotSpec, trajectory: FourierTrajectory, error_deg: float, rng: np.random.Generator
) -> RobotLog:
    """A run whose tracking error is a sine of known size, with 1 s of lead-in."""
    t = np.arange(-1.0, trajectory.duration, 1.0 / robot.rate)
    s = trajectory.sample(np.maximum(t, 0.0))
    moving = (t >= 0.0)[:, None]
    true = s.q - np.radians(error_deg) * np.sin(3.0 * t)[:, None] * moving
    wanted = 300.0 * np.tanh(s.qd / 0.02) * 0.2 + 250.0 * s.qd + 40.0 * np.sin(s.q)
    feedback = 400.0 * (s.q - true)
    return RobotLog(
        robot.names, robot.command_unit, t, true + 2e-4 * rng.standard_normal(true.shape),
        np.clip(np.round(wanted + feedback), -255, 255), q_des=s.q, qd_des=s.qd, qdd_des=s.qdd,
        tau_ff=wanted * 0.95, tau_fb=feedback, q_true=true, source="synthetic",
        repairs=("dropped 3 repeated samples",),
    )  # fmt: skip


def _tell(
    folder: Path, robot: RobotSpec, trajectory: FourierTrajectory, number: int, rng: np.random.Generator
) -> None:
    log = synthetic_log(robot, trajectory, error_after(number - 1), rng)
    path = folder / "runs" / f"{number:04d}.parquet"
    write_parquet(log, path)
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

    kind = "identified+gp"

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot

    def predict(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        far = (q / self.robot.upper) ** 2 + (qd / self.robot.velocity) ** 2
        return np.zeros_like(q), 4.0 + 900.0 * (1.0 - np.exp(-far))


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
