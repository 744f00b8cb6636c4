"""rotorpy's multirotor with what real vehicles have, flown by PX4's cascade or by rotorpy's SE(3) controller.

The dynamics are rotorpy's (`Multirotor.statedot`): rotor drag, inflow, translational lift, flapping and
parasitic drag. Added here: motors that lag, a load off the centre, ground effect (Cheeseman, Bennett 1955),
and sensors. The cascade follows PX4's documentation and source (v1.14 to main of 2026): position and velocity
by px4_cascade.py, hover thrust by the zero-order filter of mc_hover_thrust_estimator, MC_ROLL_P and the rate
PID, the normalised allocation of ControlAllocationPseudoInverse, and the thrust curve THR_MDL_FAC of
mixer_module. No line is copied.
World: east, north, up; body: forward, left, up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from px4_cascade import Parameters, PositionControl
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

DT = 0.004
"""s of a step of the plant and of the rate controller: PX4's default rate loop on slow boards."""
POSITION_EVERY, LOG_EVERY = 2, 2
"""Steps between calls of the position controller, and rows of the log: 125 Hz."""
G = 9.80665
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
RADIUS = 0.30
"""m: radius of the disk that stands for four rotors in ground effect."""
BODY = ("time", "acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z")
"""Columns of a log before those of the motors, and behind them."""
MOTION = (
    *("position_x", "position_y", "position_z", "velocity_x", "velocity_y", "velocity_z"),
    *("q_w", "q_x", "q_y", "q_z"),
)
TURN_P = np.array([6.5, 6.5, 2.8])  # MC_ROLL_P, MC_PITCH_P, MC_YAW_P
TURN_MOST = np.radians([220.0, 220.0, 200.0])
RATE_P, RATE_I, RATE_D = np.array([0.15, 0.15, 0.2]), np.array([0.2, 0.2, 0.1]), np.array([0.003, 0.003, 0.0])
ARMS = {6: 0.2, 8: 0.24}
"""Rotors of a hexacopter and an octocopter, and their distance from the centre, m."""


@dataclass(frozen=True)
class Airframe:
    """A Hummingbird with a load, or a hexacopter or octocopter of its motors.

    Attributes:
        load: kg, at `place` (3,) m from the centre of the rotors.
        lag: s of the motors. flap: flapping moment, N m s/(rad m/s).
        curve: PX4's THR_MDL_FAC, which the pilot has set; the rotors' thrust is quadratic in their set-point.
        full: rad/s at full throttle. drag: factor of all that air does.
    """

    load: float = 0.08
    place: tuple[float, float, float] = (0.04, -0.025, -0.03)
    lag: float = 0.03
    flap: float = 2e-6
    curve: float = 0.0
    full: float = 800.0
    drag: float = 1.0
    rotors: int = 4

    def bare(self) -> dict[str, Any]:
        """rotorpy's parameters without the load. Of more motors: a regular polygon, mass as thrust."""
        own, count = dict(quad_params), self.rotors
        if count == 4:
            return own
        angles, arm, share = np.pi * (2.0 * np.arange(count) + 1.0) / count, ARMS[count], count / 4.0
        own["rotor_pos"] = {
            f"r{i + 1}": arm * np.array([math.cos(a), math.sin(a), 0.0]) for i, a in enumerate(angles)
        }
        own["rotor_directions"] = np.array([1, -1] * (count // 2))
        own |= {name: share * own[name] for name in ("mass", "c_Dx", "c_Dy", "c_Dz")}
        own |= {name: share * (arm / 0.17) ** 2 * own[name] for name in ("Ixx", "Iyy", "Izz")}
        return own | {"num_rotors": count}

    def still(self) -> float:
        """rad/s at which its rotors carry it."""
        own = self.parameters()
        return math.sqrt(own["mass"] * 9.81 / self.rotors / own["k_eta"])

    def parameters(self) -> dict[str, Any]:
        """rotorpy's: positions from the centre of mass, inertia about it (parallel axes)."""
        own = self.bare()
        bare, place = own["mass"], np.array(self.place)
        mass = bare + self.load
        shift = self.load / mass * place
        reduced = bare * self.load / mass
        more = reduced * (place @ place * np.eye(3) - np.outer(place, place))
        inertia = np.diag([own["Ixx"], own["Iyy"], own["Izz"]]) + more
        names = {"Ixx": (0, 0), "Iyy": (1, 1), "Izz": (2, 2), "Ixy": (0, 1), "Ixz": (0, 2), "Iyz": (1, 2)}
        own |= {name: float(inertia[at]) for name, at in names.items()}
        own |= {
            "mass": mass,
            "tau_m": self.lag,
            "k_flap": self.drag * self.flap,
            "rotor_speed_max": self.full,
        }
        own |= {name: self.drag * own[name] for name in ("c_Dx", "c_Dy", "c_Dz", "k_d", "k_z", "k_h")}
        own["rotor_pos"] = {name: at - shift for name, at in own["rotor_pos"].items()}
        return own


class NearGround(Multirotor):
    """rotorpy's multirotor, whose rotors lift more near the ground; `height` is set before each step."""

    height = 10.0

    def __init__(self, own: dict[str, Any]) -> None:
        """rotorpy inverts the allocation of four rotors; its equations of motion take any number."""
        four = dict(list(own["rotor_pos"].items())[:4])
        super().__init__(
            own | {"num_rotors": 4, "rotor_pos": four, "rotor_directions": own["rotor_directions"][:4]}
        )
        self.num_rotors, self.rotor_pos = own["num_rotors"], own["rotor_pos"]
        self.rotor_dir = own["rotor_directions"]
        self.extract_geometry()

    def statedot(self, state: dict[str, Array], control: dict[str, Array], t_step: float) -> dict[str, Array]:
        """As rotorpy's, which packs the state of four rotors."""
        names = ("x", "v", "q", "w", "wind", "rotor_speeds")
        speeds = within(control["cmd_motor_speeds"], self.rotor_speed_min, self.rotor_speed_max)
        rate = self._s_dot_fn(0.0, np.concatenate([state[name] for name in names]), speeds)
        return {"vdot": rate[3:6], "wdot": rate[10:13]}

    def compute_body_wrench(
        self, body_rates: Array, rotor_speeds: Array, airspeed: Array
    ) -> tuple[Array, Array]:
        """Speeds are raised by the root of what the ground adds to thrust; drag torque goes with them."""
        ratio = RADIUS / (4.0 * max(self.height, 0.5 * RADIUS))
        return super().compute_body_wrench(body_rates, rotor_speeds / math.sqrt(1.0 - ratio**2), airspeed)


@dataclass
class HoverThrust:
    """Hover thrust from vertical acceleration: PX4's filter of one constant state."""

    value: float = 0.5  # MPC_THR_HOVER
    variance: float = 0.1**2  # HTE_HT_ERR_INIT
    noise: float = 0.0036**2  # HTE_HT_NOISE
    measured: float = 5.0**2 / 5.0
    gate: float = 3.0  # HTE_ACC_GATE

    def fuse(self, up: float, thrust: float, dt: float) -> float:
        """The estimate after an upward acceleration (m/s^2) under a vertical thrust."""
        self.variance += self.noise * dt * dt
        slope = -G * thrust / self.value**2
        expected = G * thrust / self.value - G
        spread = max(slope * self.variance * slope + self.measured, self.measured)
        miss = up - expected
        if miss * miss < self.gate**2 * spread:
            gain = self.variance * slope / spread
            self.value = min(max(self.value + gain * miss, 0.1), 0.9)
            self.variance = min(max((1.0 - gain * slope) * self.variance, 1e-10), 1.0)
        return self.value


@dataclass
class Cascade:
    """PX4's controllers from a set-point to four motors, parts of full scale.

    Attributes:
        gain: MC_ROLLRATE_K and its like. hover: the estimate of hover thrust.
    """

    frame: Airframe
    gain: float = 0.35
    hover: HoverThrust = field(default_factory=HoverThrust)

    def __post_init__(self) -> None:
        # hover thrust is estimated, so it starts where a vehicle that has flown before left MPC_THR_HOVER
        self.outer = PositionControl(
            (), replace(Parameters(), hover=self.hover.value, up_max=6.0, down_max=6.0)
        )
        self.wanted, self.thrust = np.eye(3), 0.0
        self.vertical = np.zeros(3)
        self.rate_integral, self.filtered, self.turned = np.zeros(3), np.zeros(3), np.zeros(3)
        self.mix = _allocation(self.frame)

    def position(self, state: tuple[Array, Array, Array], row: Array, yaw: float, dt: float) -> None:
        """A new wanted attitude and thrust; state and row in east, north, up."""
        own = tuple(NED @ part for part in state)
        asked = tuple(NED @ row[3 * i : 3 * i + 3] for i in range(3))
        force = self.outer.thrust(own, asked, dt)  # type: ignore[arg-type]
        self.vertical = NED @ force
        self.thrust = float(np.linalg.norm(force))
        self.wanted = attitude_of(self.vertical, yaw)

    def learn_hover(self, up: float, dt: float) -> None:
        """The estimate moves; the vertical integral takes up the step (updateHoverThrust)."""
        before = self.outer.given.hover
        after = self.hover.fuse(up, float(self.vertical[2]), dt)
        asked = G - self.vertical[2] * G / before  # of down: thrust = (asked - g) hover / g
        self.outer.integral[2] += (asked - G) * before / after + G - asked
        self.outer.given = replace(self.outer.given, hover=after)

    def motors(self, attitude: Array, rates: Array, dt: float) -> Array:
        """(n,) controls of the allocator."""
        error = Rotation.from_matrix(attitude.T @ self.wanted).as_rotvec()
        miss = within(TURN_P * error, -TURN_MOST, TURN_MOST) - rates
        turning = (rates - self.filtered) / dt
        share = 1.0 - math.exp(-2.0 * math.pi * 30.0 * dt)  # IMU_DGYRO_CUTOFF
        self.turned = self.turned + share * (turning - self.turned)
        self.filtered = rates.copy()
        torque = self.gain * (RATE_P * miss + self.rate_integral - RATE_D * self.turned)
        torque[2] += (1.0 - self.gain) * RATE_P[2] * miss[2]
        self.rate_integral = within(self.rate_integral + RATE_I * miss * dt, -0.3, 0.3)
        return within(self.mix @ np.array([self.thrust, *torque]), 0.0, 1.0)


@dataclass
class Geometric(Cascade):
    """rotorpy's SE(3) controller (Lee, Leok and McClamroch 2010), normalised by PX4's hover thrust.

    It knows the mass and the bare geometry; it feeds accelerations forward as they are.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        own = self.frame.parameters()
        self.own = SE3Control({**own, "rotor_pos": quad_params["rotor_pos"]})
        self.weight = own["mass"] * 9.81
        self.asked: dict[str, Any] = {}

    def position(self, state: tuple[Array, Array, Array], row: Array, yaw: float, dt: float) -> None:
        """The newest state and set-point."""
        self.place, self.speed = state[:2]
        self.asked = {"x": row[:3], "x_dot": row[3:6], "x_ddot": row[6:9], "yaw": yaw, "yaw_dot": 0.0}

    def learn_hover(self, up: float, dt: float) -> None:
        """The estimate alone: there is no integral."""
        self.hover.fuse(up, float(self.vertical[2]), dt)

    def motors(self, attitude: Array, rates: Array, dt: float) -> Array:
        """(4,) controls: its rotor thrusts, where a quarter of the weight is hover thrust."""
        quat = Rotation.from_matrix(attitude).as_quat()
        seen = {"x": self.place, "v": self.speed, "q": quat, "w": rates}
        found = self.own.update(0.0, seen, self.asked)
        controls = self.hover.value * found["cmd_motor_thrusts"] / (0.25 * self.weight)
        self.vertical = attitude[:, 2] * controls.mean()
        return within(controls, 0.0, 1.0)


def within(values: Array, low: Array | float, high: Array | float) -> Array:
    """np.clip, in a third of its time for a few numbers."""
    return np.asarray(np.minimum(np.maximum(values, low), high))


def _allocation(frame: Airframe) -> Array:
    """(n, 4) thrust and torques to motors: the inverse of the bare frame, normalised as PX4 does."""
    own = frame.bare()
    places = np.stack(list(own["rotor_pos"].values()))
    spins = own["rotor_directions"]
    effect = np.stack([np.ones(len(spins)), places[:, 1], -places[:, 0], 0.05 * spins])
    mix = np.linalg.pinv(effect)
    mix[:, 0] /= mix[:, 0].mean()
    for j in (1, 2, 3):
        mix[:, j] /= math.sqrt((mix[:, j] ** 2).sum() / (0.5 * len(spins)))
    return mix


def attitude_of(force: Array, yaw: float) -> Array:
    """Columns x, y, z of the body whose thrust is along `force` and that looks along `yaw`."""
    z = force / np.linalg.norm(force)
    y = np.cross(z, [math.cos(yaw), math.sin(yaw), 0.0])
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])


@dataclass(frozen=True, eq=False)
class Flight:
    """What was flown, ENU: t (T,) s, position and the set-point's (T, 3) m; log of BODY, motors and MOTION;
    hover thrust.
    """

    t: Array
    position: Array
    wanted: Array
    log: Array
    hover: float

    def error(self, after: float = 5.0) -> float:
        """Mean distance from the set-points after so many seconds, m."""
        kept = self.t >= after
        return float(np.linalg.norm(self.position - self.wanted, axis=1)[kept].mean())

    def csv(self) -> str:
        """The log as a table."""
        rows = "\n".join(",".join(f"{value:.9g}" for value in row) for row in self.log)
        motors = [f"motor_{i + 1}" for i in range(self.log.shape[1] - len(BODY) - len(MOTION))]
        return ",".join([*BODY, *motors, *MOTION]) + "\n" + rows + "\n"


Onboard = Callable[[Array, float, float, Array], Array]
"""(row, seconds since it came, hover thrust, motors) -> motors: what runs on the autopilot beside its own."""


def played(table: Array, t: float, rate: float = 50.0) -> Array:
    """The row that a player has sent by then; the first before, the last after."""
    return np.asarray(table[min(max(int(t * rate + 1e-6), 0), len(table) - 1)])


def fly(
    table: Array,
    *,
    frame: Airframe | None = None,
    seed: int = 0,
    onboard: Onboard | None = None,
    lead: float = 0.0,
    tail: float = 0.0,
    noise: float = 1.0,
    hover: float | None = None,
    controller: type[Cascade] = Cascade,
) -> Flight:
    """Set-points (N, 9) of position, velocity, acceleration (ENU, 50 Hz) through PX4's cascade, or another.

    Args:
        onboard: what is added to the motors. lead, tail: s of hovering at the first row and on the last row;
            without a lead it begins in the motion of the first row.
        noise: factor of all sensors' noise. hover: MPC_THR_HOVER; None: what the vehicle takes.
    """
    frame = frame or Airframe()
    rng, own = np.random.default_rng(seed), frame.parameters()
    plant = NearGround(own)
    first = table[0]
    still = frame.still()
    usual = _uncurved(still / frame.full, frame.curve) if hover is None else hover
    control = controller(frame, hover=HoverThrust(usual))
    state = {
        "x": first[:3].copy(),
        "v": np.zeros(3) if lead > 0.0 else first[3:6].copy(),
        "q": Rotation.from_euler("z", 0.0).as_quat(),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(frame.rotors, still),
    }
    count = round((lead + tail + len(table) / 50.0) / DT)
    kept: list[Array] = []
    places: list[Array] = []
    rate_seen, push, down = np.zeros(3), np.array([0.0, 0.0, 9.81]), np.array([0.0, 0.0, -9.81])
    for k in range(count):
        t = k * DT - lead
        row = played(table, t) if t >= 0.0 else np.concatenate([first[:3], np.zeros(6)])
        attitude = Rotation.from_quat(state["q"]).as_matrix()
        gyro = state["w"] + noise * 0.01 * rng.standard_normal(3)
        if k % POSITION_EVERY == 0:
            step = POSITION_EVERY * DT
            seen = (
                state["x"] + noise * 0.004 * rng.standard_normal(3),
                state["v"] + noise * 0.015 * rng.standard_normal(3),
                rate_seen,
            )
            control.position(seen, row, 0.0, step)
            up = float(attitude[2] @ push - 9.81)
            control.learn_hover(up + noise * 0.3 * float(rng.standard_normal()), step)
        motors = control.motors(attitude, gyro, DT)
        if onboard is not None and t >= 0.0:
            motors = np.clip(onboard(row, t, control.hover.value, motors), 0.0, 1.0)
        speeds = _curved(motors, frame.curve) * frame.full
        if k % LOG_EVERY == 0 and t >= 0.0:
            force = push + noise * 0.25 * rng.standard_normal(3)
            shown = np.clip(motors + noise * 0.002 * rng.standard_normal(frame.rotors), 0.0, 1.0)
            quat = state["q"][[3, 0, 1, 2]]
            kept.append(np.concatenate([[t], force, gyro, shown, seen[0], seen[1], quat]))
            places.append(np.concatenate([[t], state["x"], row[:3]]))
        acceleration = _advance(plant, state, speeds, frame.lag)
        push = attitude.T @ (acceleration - down)
        share = 1.0 - math.exp(-2.0 * math.pi * 5.0 * DT)  # MPC_VELD_LP
        rate_seen = rate_seen + share * (acceleration - rate_seen)
        if not np.isfinite(state["x"]).all() or np.abs(state["x"]).max() > 1e3:
            raise FloatingPointError("the vehicle is lost")
    at = np.array(places)
    return Flight(at[:, 0], at[:, 1:4], at[:, 4:7], np.array(kept), control.hover.value)


def _advance(plant: NearGround, state: dict[str, Array], speeds: Array, lag: float) -> Array:
    """One step, by the midpoint; returns the acceleration (3,) of the centre of mass, world frame."""
    plant.height = float(state["x"][2])
    control = {"cmd_motor_speeds": speeds}
    half = _moved(state, plant.statedot(state, control, DT), speeds, 0.5 * DT, lag, state)
    middle = plant.statedot(half, control, DT)
    after = _moved(state, middle, speeds, DT, lag, half)
    state.update(after)
    return np.asarray(middle["vdot"])


def _moved(
    state: dict[str, Array],
    rate: dict[str, Array],
    speeds: Array,
    dt: float,
    lag: float,
    at: dict[str, Array],
) -> dict[str, Array]:
    turn = Rotation.from_quat(state["q"]) * Rotation.from_rotvec(at["w"] * dt)
    return {
        "x": state["x"] + at["v"] * dt,
        "v": state["v"] + rate["vdot"] * dt,
        "q": turn.as_quat(),
        "w": state["w"] + rate["wdot"] * dt,
        "wind": state["wind"],
        "rotor_speeds": speeds + (state["rotor_speeds"] - speeds) * math.exp(-dt / lag),
    }


def _curved(control: Array, factor: float) -> Array:
    """What the output driver makes of a control: thrust = f u^2 + (1 - f) u is solved for u (THR_MDL_FAC)."""
    if factor == 0.0:
        return control
    half = (1.0 - factor) / (2.0 * factor)
    return np.asarray(np.sqrt(half**2 + control / factor) - half)


def _uncurved(u: float, factor: float) -> float:
    return factor * u * u + (1.0 - factor) * u


def exact_acceleration(table: Array, frame: Airframe) -> Array:
    """Set-points whose accelerations hold against all that the plant's air does: nobody else can know it."""
    own = frame.parameters()
    plant, mass, out = NearGround(own), own["mass"], table.copy()
    up = np.array([0.0, 0.0, 9.81])
    for row in out:
        plant.height, wanted = float(row[2]), row[6:9].copy()
        for _ in range(4):
            turn = attitude_of(row[6:9] + up, 0.0)
            speeds = np.full(4, math.sqrt(mass * np.linalg.norm(row[6:9] + up) / 4.0 / own["k_eta"]))
            force, _ = plant.compute_body_wrench(np.zeros(3), speeds, turn.T @ row[3:6])
            force[2] -= own["k_eta"] * float((speeds**2).sum())
            row[6:9] = wanted - turn @ force / mass
    return out
