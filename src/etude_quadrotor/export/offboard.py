"""Set-points for PX4's offboard mode, in its frame (north, east, down), and the program that sends them.

PX4 holds each set-point until the next: its controllers use position, velocity and acceleration unchanged, so
these are certified. If a model knows the drag, the accelerations are commands. They are the motion's own, the
compensation of the drag, and that of PX4's cascade, and the two additions have separate columns. PX4 holds
the last row, so the table ends with half a second at rest.

PX4's cascade answers a horizontal acceleration late, since it has to turn the vehicle first. At low
frequencies the delay of its attitude loop is exactly 1/MC_ROLL_P, whatever its motors' lag, since that is
inside the loop. Its velocity controller also subtracts MPC_XY_VEL_D_ACC times the measured acceleration
(PositionControl::_velocityControl, v1.14 to main of 2026). So horizontal accelerations are those of
1/MC_ROLL_P later, plus that part of the motion's own. Without this a late acceleration of frequency w pushes
along the velocity by w^2/MC_ROLL_P: it hides drag, and compensation of the drag alone makes errors larger.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from etude._runtime.rounding import whole_up
from etude.deploy.exporters.joint_trajectory import player
from etude.deploy.exporters.knots import require_space
from etude.deploy.feedforward import MotionWithCommands
from etude.limits.lead_ins import STILL
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined
from etude.types import Array, Mask
from etude_quadrotor.spec import QuadrotorSpec

TABLE, PLAYER = "setpoints.csv", "play.py"
RATE = 50.0
"""Hz; offboard mode ends below 2."""
ORDERS = 3  # position, velocity, acceleration
HELD_S = 0.5
"""s of rows at rest after the motion, so that a reader that stops early still gets one."""
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""(north, east, down) <- (east, north, up), and back."""
YAW = 0.5 * math.pi
"""Heading zero looks east."""
DRAG = ["drag_north", "drag_east", "drag_down"]
"""m/s^2: the part of the accelerations that compensates drag."""
CASCADE = ["cascade_north", "cascade_east", "cascade_down"]
"""m/s^2: the part that compensates delay and damping of PX4's cascade."""
STATED = "damping_stated"
"""1: robot.toml states the damping. 0: it is assumed; vehicles without it keep the limit of the tilt, too."""
GRAVITY = 9.80665
"""m/s^2, PX4's CONSTANTS_ONE_G (src/lib/geo/geo.h)."""
GAINS = ((0.95, 1.8, 0.4, QuadrotorSpec.velocity_damping), (1.0, 4.0, 2.0, 0.0))
"""Sideways and up: P of the position, and P, I, D of the velocity. PX4's defaults: MPC_XY_P,
MPC_XY_VEL_P_ACC, MPC_XY_VEL_I_ACC, MPC_XY_VEL_D_ACC, and those of Z.
"""
LAG = 1.0 / QuadrotorSpec.attitude_gain
"""s: time constant of the attitude, and so of the acceleration, with PX4's default MC_ROLL_P."""
AFTER_S = 10.0
"""s after the last row in which the vehicle still converges."""
UNSTATED = (
    " Without a stated velocity_damping no set-point asks for more tilt than the limit. To use all of it, "
    "state MPC_XY_VEL_D_ACC as velocity_damping in robot.toml."
)
HEADER = ["time", *(prefix + axis for prefix in ("", "v", "a") for axis in ("north", "east", "down")), "yaw"]


class Offboard:
    """A `protocols.Exporter`: setpoints.csv and play.py, a node for rclpy and px4_msgs."""

    def __call__(self, what: Trajectory | MotionWithCommands, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """Both files. UsageError: no path in space."""
        self.require_robot(kind, spec)
        motion = what.trajectory if isinstance(what, MotionWithCommands) else what
        count = whole_up(motion.duration * RATE) + 1
        t = np.arange(count + round(HELD_S * RATE)) / RATE
        orders = motion.motion(t, ORDERS).orders @ NED.T  # at rest after the end
        still = np.abs(orders[1:]).max(axis=(0, 2)) <= STILL
        orders[1:, still] = 0.0  # set-points at rest are exact
        columns, header = list(orders), list(HEADER)
        if isinstance(what, MotionWithCommands) and what.acceleration is not None:
            drag, cascade = _additions(what, t, orders[2], still, spec)
            if not spec.damping_stated:
                cascade = _within_tilt(orders[2] + drag, cascade, what.tilt)
            columns[2], header = orders[2] + drag + cascade, [*HEADER, *DRAG, *CASCADE, STATED]
            columns += [drag, cascade, np.full((len(t), 1), float(spec.damping_stated))]
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(header)
        rows = np.concatenate(columns, axis=1).astype(np.float32).astype(float)
        lines.writerows(
            [*map(repr, [seconds, *row[:9], YAW, *row[9:]])]
            for seconds, row in zip(t.tolist(), rows.tolist(), strict=True)
        )
        return {
            TABLE: text.getvalue().encode(),
            PLAYER: player("etude_quadrotor.export", "play_setpoints.py"),
        }

    def require_robot(self, kind: Kind, spec: Any) -> None:
        """UsageError: no path in space."""
        require_space(kind, spec, "an autopilot")

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """The motion of the set-points, each held until the next, in single precision; east, north, up.

        Accelerations are the motion's own.
        """
        t, points, drag, cascade = _read(files)
        points[2] -= drag + cascade
        return Splined(t, points @ NED.T, held=True)

    def accelerations(self, files: Mapping[str, bytes]) -> Array | None:
        """(K, 3) that are commanded, m/s^2, east, north, up; None: the motion's own."""
        _, points, drag, _ = _read(files)
        return np.asarray(points[2] @ NED.T) if drag.any() else None

    def answered(self, files: Mapping[str, bytes]) -> Array | None:
        """(T, 3) m/s^2 that PX4's cascade may make of them, so the vehicle tilts by these; None: the motion's
        own. East, north, up.

        First those that it is expected to make. Where its damping is assumed, also those of a vehicle without
        that delay and damping, and the same where its tilt ignores vertical acceleration.
        """
        _, points, drag, cascade = _read(files)
        if not drag.any():
            return None
        if _is_stated(files):
            return np.asarray((points[2] - cascade) @ NED.T)
        decoupled = points[2] * [1.0, 1.0, 0.0]  # MPC_ACC_DECOUPLE: the tilt is that of no vertical part
        return np.asarray(np.concatenate([points[2] - cascade, points[2], decoupled]) @ NED.T)

    def strays(self, files: Mapping[str, bytes]) -> tuple[Array, Array] | None:
        """Positions (K, 3) m of the set-points, held after the last, and the vehicle's deviation (K, 3) m
        from each. The deviation is that of a compensation of drag that is wrong by up to 100 %, beyond
        tracking. None: no compensation. East, north, up.
        """
        _, points, drag, _ = _read(files)
        if not drag.any():
            return None
        after = round(AFTER_S * RATE)
        places = np.pad(points[0], ((0, after), (0, 0)), mode="edge")
        size = np.abs(np.pad(drag, ((0, after), (0, 0))))
        sideways, up = (np.abs(_push_response(gains)) for gains in GAINS)
        off = [
            np.convolve(size[:, i], response)[: len(size)] / RATE
            for i, response in enumerate((sideways, sideways, up))
        ]
        return places @ NED.T, np.abs(np.stack(off, axis=1) @ NED.T)

    def notes(self, files: Mapping[str, bytes]) -> tuple[str, ...]:
        """Sentences if accelerations are commands: their part beyond the motion, and the deviation if that
        part is wrong.
        """
        _, points, drag, cascade = _read(files)
        if not drag.any():
            return ()
        most = float(np.linalg.norm(drag, axis=1).max())
        answered = points[2] - cascade
        answered_tilt, motion_tilt = (math.degrees(_tilt(a)) for a in (answered, answered - drag))
        beside = self.strays(files)
        assert beside is not None
        east, north, up = beside[1].max(axis=0)
        return (
            "The acceleration set-points are commands, not the motion: they compensate the learned drag, "
            f"with up to {most:.3g} m/s^2, and tilt up to {answered_tilt:.3g} degrees, the motion alone "
            f"{motion_tilt:.3g}. Limits are proved for the motion, and the tilt limit also for what PX4 "
            "makes of the commands.",
            "Horizontal accelerations also allow for the delay and the damping of PX4's cascade, with up to "
            f"{np.linalg.norm(cascade, axis=1).max():.3g} m/s^2 in the columns cascade_*. They assume "
            "attitude_gain and velocity_damping of robot.toml, which are PX4's defaults unless stated."
            + ("" if _is_stated(files) else UNSTATED),
            "If the learned drag is wrong by at most its full size, the vehicle may leave the plan by "
            f"{east:.2g} m along x, {north:.2g} along y and {up:.2g} along z, in addition to the tracking "
            "error, with PX4's default gains.",
        )


def _additions(
    what: MotionWithCommands, t: Array, own: Array, still: Mask, spec: QuadrotorSpec
) -> tuple[Array, Array]:
    """(K, 3) twice: what is added to the motion's own accelerations (K, 3) against drag, and for PX4's
    cascade.

    Nothing is added to rows at rest, and the lead increases from 0 after each, so that there is no step.
    Without drag nothing is added at all: delay and damping then replace the drag that is not compensated.
    """
    assert what.acceleration is not None
    end = what.trajectory.duration
    moves = ((t <= end) & ~still)[:, None]
    now = what.acceleration(np.minimum(t, end)) @ NED.T
    since = t - np.maximum.accumulate(np.where(still, t, -np.inf))
    ahead = np.minimum(t + np.minimum(1.0 / spec.attitude_gain, since), end)
    cascade = what.acceleration(ahead) @ NED.T - now + spec.velocity_damping * own
    cascade[:, 2] = 0.0  # thrust answers within the motors' lag
    drag = np.where(moves, now - own, 0.0)
    return drag, np.where(moves & drag.any(), cascade, 0.0)


def _within_tilt(now: Array, cascade: Array, tilt: float) -> Array:
    """What is added for PX4's cascade (K, 3), reduced so that no set-point asks for more than this tilt: a
    vehicle without the delay and the damping that are assumed keeps the limit, too.
    """
    if not np.isfinite(tilt):
        return cascade
    asked = (now + cascade)[:, :2]
    most = math.tan(tilt) * np.minimum(GRAVITY, GRAVITY - now[:, 2])
    size = np.maximum(np.hypot(asked[:, 0], asked[:, 1]), 1e-9)  # without any, nothing is reduced
    asked *= np.minimum(1.0, most / size)[:, None]
    return np.concatenate([asked - now[:, :2], cascade[:, 2:]], axis=1)


def _is_stated(files: Mapping[str, bytes]) -> bool:
    """Whether robot.toml stated the damping; so do files of before, which have no such column."""
    header, first = csv.reader(files[TABLE].decode().split("\n", 2)[:2])
    return STATED not in header or float(first[header.index(STATED)]) > 0.0


def _read(files: Mapping[str, bytes]) -> tuple[Array, Array, Array, Array]:
    """Times (K,), position, velocity and acceleration (3, K, 3), and what these contain against drag and for
    PX4's cascade (K, 3); north, east, down.
    """
    header, *rows = csv.reader(io.StringIO(files[TABLE].decode()))
    table = np.array([[float(cell) for cell in row] for row in rows]).astype(np.float32).astype(float)
    place = {name: i for i, name in enumerate(header)}
    points = table[:, [place[name] for name in HEADER[1:-1]]].reshape(len(table), ORDERS, 3)
    t, none = np.array([float(row[0]) for row in rows]), np.zeros((len(table), 3))
    drag, cascade = (
        table[:, [place[name] for name in names]] if set(names) <= set(place) else none
        for names in (DRAG, CASCADE)
    )
    return t, np.moveaxis(points, 1, 0).copy(), drag, cascade


def _push_response(gains: tuple[float, float, float, float]) -> Array:
    """(K,) m/(m/s), at `RATE`: deviation of a vehicle after a step of its velocity.

    The state is position, velocity, acceleration and integral; the feedback's acceleration lags by `LAG`.
    """
    from scipy.linalg import expm

    place, p, i, d = gains
    rates = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [-p * place / LAG, -p / LAG, -(1.0 + d) / LAG, 1.0 / LAG],
            [-i * place, -i, 0.0, 0.0],
        ]
    )
    step, state = expm(rates / RATE), np.array([0.0, 0.0, 1.0 / LAG, 0.0])
    deviation = np.zeros(round(2.0 * AFTER_S * RATE))
    for k in range(len(deviation)):
        deviation[k], state = state[0], step @ state
    return deviation


def _tilt(acceleration: Array) -> float:
    """Largest angle of the thrust that gives these accelerations (K, 3), north, east, down, rad."""
    thrust = acceleration - [0.0, 0.0, GRAVITY]
    return float(np.arctan2(np.hypot(thrust[:, 0], thrust[:, 1]), -thrust[:, 2]).max())


OFFBOARD = Offboard()
