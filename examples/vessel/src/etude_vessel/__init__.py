"""A small surface vessel as a kind of robot: thrust along x and y against inertia, drag and a current.

World frame, heading held at zero. The path is its position; learned is the thrust that a motion needs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from etude import types
from etude.errors import UsageError
from etude.limits import AxisLimit, LimitTable, made_limits, read_limits
from etude.logs import smooth
from etude.protocols import Controller, Limit, Model, Trajectory
from etude.toml_tables import decoded, from_table, read_text
from etude.trajectories import FourierConfig, FourierFamily, random_moves
from etude.types import Array, Channel, Index, Log, Motion, Row, Samples

AXES, STATES = ("x", "y"), ("position", "velocity", "acceleration")
ALL = (
    Channel("position", AXES, ("m", "m"), required=True),
    Channel("velocity", AXES, ("m/s", "m/s"), derivative_of="position"),
    Channel("acceleration", AXES, ("m/s^2", "m/s^2"), derivative_of="velocity"),
    Channel("position_des", AXES, ("m", "m"), "plan"),
    Channel("command", AXES, ("N", "N"), "command", required=True, acts_on="position"),
)
CHANNELS = {channel.name: channel for channel in ALL}


def _row(t: float, row: Row) -> Log:
    return Log(np.array([t]), CHANNELS, {name: values[None] for name, values in row.items()})


@dataclass(frozen=True)
class VesselSpec:
    """As its owner describes it: basin (m), speed (m/s), acceleration (m/s^2), thrust (N), own limits."""

    name: str
    rate: float
    lower: tuple[float, float]
    upper: tuple[float, float]
    speed: float
    acceleration: float
    thrust: tuple[float, float]
    kind: str = "vessel"
    simulated: bool = False
    limits: tuple[LimitTable, ...] = ()


@dataclass(frozen=True)
class VesselData:
    """cutoff_hz of the zero-phase filter; one sample in `every` is learned."""

    cutoff_hz: float = 1.0
    every: int = 5


@dataclass(frozen=True)
class VesselInputs:
    """x = [position, velocity, acceleration, v|v|]: the last is what quadratic drag is linear in."""

    orders: int = 3
    rate: float = 0.0

    @property
    def columns(self) -> Sequence[types.Column]:
        plain = [(name, a, CHANNELS[name].units[0], "") for name in STATES for a in AXES]
        return [*plain, *(("velocity", a, "m^2/s^2", "square") for a in AXES)]

    def states(self, motion: Motion) -> Log:
        named = dict(zip((*STATES, "position_des"), motion.orders[[0, 1, 2, 0]], strict=True))
        return Log(motion.t, {name: CHANNELS[name] for name in named}, named)

    def of_log(self, log: Log) -> Array:
        v = log["velocity"]
        return np.concatenate([*(log[name] for name in STATES), v * np.abs(v)], axis=1)

    def plan(self, motion: Motion, keep: Index | None = None) -> types.Planned:
        kept = slice(None) if keep is None else keep
        X, v = self.of_log(self.states(motion)), motion.orders[1]

        def vjp(in_X: Array, in_gains: Array) -> Array:
            out = np.zeros_like(motion.orders)
            out[:3, kept] = in_X[:, :6].reshape(-1, 3, 2).swapaxes(0, 1)
            out[1, kept] += 2.0 * np.abs(v[kept]) * in_X[:, 6:8]
            return out

        return types.Planned(X[kept], np.ones((len(X[kept]), 2)), vjp)

    def step(self, row: Row, memory: Array | None) -> tuple[Array, Array]:
        return self.of_log(_row(0.0, row))[0], np.zeros(0)

    def rates(self, motion: Motion) -> None:
        return None

    def fitted(self, samples: Samples) -> VesselInputs:
        return self

    def arrays(self) -> Mapping[str, Array]:
        return {}

    def restore(self, arrays: Mapping[str, Array]) -> VesselInputs:
        return self

    def c(self, name: str) -> None:
        return None


@dataclass(frozen=True)
class VesselMean:
    """thrust = mass a + drag v + constant, for each axis: weights (3, 2)."""

    weights: Array

    def parameters(self) -> Mapping[str, tuple[float, float]]:
        return {f"mass_{a}": (float(self.weights[0, j]), np.inf) for j, a in enumerate(AXES)}

    def predict(self, log: Log) -> Array:
        mass, drag, constant = self.weights
        return np.asarray(mass * log["acceleration"] + drag * log["velocity"] + constant)

    def static(self, log: Log) -> Array:
        return np.tile(self.weights[2], (len(log), 1))

    def arrays(self) -> Mapping[str, Array]:
        return {"weights": self.weights}

    def c(self, name: str) -> None:
        return None


class Identified:
    """Mass, linear drag and a constant by least squares."""

    def __call__(self, samples: Samples | None) -> VesselMean:
        assert samples is not None  # only a nominal structure is asked without
        log, weights = samples.log, np.zeros((3, 2))
        for j in range(2):
            A = np.column_stack([log["acceleration"][:, j], log["velocity"][:, j], np.ones(len(log))])
            weights[:, j] = np.linalg.lstsq(A, samples.command[:, j], rcond=None)[0]
        return VesselMean(weights)

    def restore(self, arrays: Mapping[str, Array]) -> VesselMean:
        return VesselMean(np.asarray(arrays["weights"]))


@dataclass(frozen=True)
class Feedforward:
    """A learned model beside the position controller: its mean, never beyond the thrusters."""

    model: Model
    thrust: Array

    def planned(self, motion: Motion) -> Array:
        return np.clip(self.model.predict(self.model.inputs.states(motion))[0], -self.thrust, self.thrust)

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        mean, variance = self.model.predict(_row(t, row))
        return np.clip(mean[0], -self.thrust, self.thrust), np.sqrt(variance[0])

    def observe(self, t: float, row: Row) -> None:
        """A frozen model learns nothing."""


@dataclass(frozen=True)
class SimulatedVessel:
    """Added mass, linear and quadratic drag and an eddy that no data sheet knows; PD at the log's rate."""

    spec: VesselSpec
    payload: float = 0.0
    mass: tuple[float, float] = (46.0, 62.0)
    drag: tuple[float, float] = (9.0, 16.0)
    square: tuple[float, float] = (14.0, 30.0)
    asks_each_tick = True  # a controller that plans nothing

    def run(self, trajectory: Trajectory, controller: Controller | None, rng: np.random.Generator) -> Log:
        dt, fine, rows = 1.0 / self.spec.rate, 10, []
        t = np.arange(int(trajectory.duration * self.spec.rate + 1e-9), dtype=float) * dt
        motion = trajectory.motion(t, 3)
        ahead = controller.planned(motion) if controller else None
        p, v, limit = motion.orders[0, 0].copy(), motion.orders[1, 0].copy(), np.array(self.spec.thrust)
        mass = np.array(self.mass) + self.payload
        for i in range(len(t)):
            plan = dict(zip((*STATES, "position_des"), motion.orders[[0, 1, 2, 0], i], strict=True))
            ff = ahead[i] if ahead is not None else controller.command(t[i], plan)[0] if controller else 0.0
            u = np.clip(30.0 * (plan["position"] - p) + 40.0 * (plan["velocity"] - v) + ff, -limit, limit)
            rows.append((p + 0.002 * rng.standard_normal(2), u))
            if controller:
                controller.observe(t[i], plan | {"position": rows[-1][0], "command": u})
            for _ in range(fine):
                a = (u - self.resistance(p, v)) / mass
                p, v = p + dt / fine * v, v + dt / fine * a
        values = {"position": np.array([r[0] for r in rows]), "command": np.array([r[1] for r in rows])}
        values["position_des"] = motion.orders[0]
        return Log(t, {name: CHANNELS[name] for name in values}, values, source=f"simulated {self.spec.name}")

    def resistance(self, p: Array, v: Array) -> Array:
        """(2,) N: drag through water that turns slowly about the middle of the basin."""
        through = v - 0.05 * np.array([-np.sin(p[1]), np.sin(p[0])])
        return np.asarray(np.array(self.drag) * through + np.array(self.square) * through * np.abs(through))

    def error(self, log: Log) -> tuple[Array, tuple[str, ...]]:
        return np.abs(log["position_des"] - log["position"])[log.t >= 5.0].mean(axis=0), ("m", "m")

    def changed(self, **what: float) -> SimulatedVessel:
        if set(what) - {"payload"}:
            raise UsageError(f"a vessel can change its payload, not {', '.join(what)}")
        return replace(self, payload=what["payload"])


class VesselKind:
    """See `etude.protocols.Kind`."""

    name, path = "vessel", "position"
    tables: Mapping[str, type] = {"trajectory": FourierConfig, "data": VesselData}
    presets: Mapping[str, Any] = {"default": {"model": {"kernel": "ard_se"}}, "thesis": {}}
    comments: Mapping[str, Mapping[str, str]] = {"data": {"cutoff_hz": "Hz, zero-phase filter"}}

    def built_in(self) -> Mapping[str, Path]:
        return {"vessel": Path(__file__).with_name("vessel.toml")}

    def recognises(self, path: Path) -> bool:
        return path.suffix == ".toml" and decoded(read_text(path), str(path)).get("kind") == self.name

    def described(self, path: Path) -> types.Described:
        return types.Described({"robot.toml": path.read_bytes()})

    def spec(self, path: Path) -> VesselSpec:
        table = decoded(read_text(path), str(path))
        own = read_limits(table.pop("limit", ()), str(path))  # [[limit]], checked while the file is read
        return replace(from_table(VesselSpec, table, str(path)), limits=own)

    def home(self, spec: VesselSpec) -> Array:
        return np.asarray(0.5 * (np.array(spec.lower) + np.array(spec.upper)))

    def limit(self, spec: VesselSpec) -> Array:
        return np.array(spec.thrust)

    def channels(self, spec: VesselSpec) -> Sequence[Channel]:
        return ALL

    def expected(self, spec: VesselSpec) -> types.Expected:
        room = np.array(spec.lower), np.array(spec.upper)
        return types.Expected(spec.rate, room[1] - room[0], {"position": room})

    def family(self, spec: VesselSpec, config: Any) -> FourierFamily:
        return FourierFamily.of(config.trajectory, 2)

    def limits(self, spec: VesselSpec, config: Any, model: Model | None, margins: Any) -> Sequence[Limit]:
        return (
            AxisLimit("position", 0, AXES, np.array(spec.lower), np.array(spec.upper)),
            AxisLimit("velocity", 1, AXES, np.full(2, -spec.speed), np.full(2, spec.speed), rest=True),
            AxisLimit("acceleration", 2, AXES, np.full(2, -spec.acceleration), np.full(2, spec.acceleration)),
            *made_limits(spec.limits, spec, model, margins, AXES),
        )

    def approaches(self, spec: VesselSpec, motion: Trajectory, pose: Array) -> None:
        return None

    def inputs(self, spec: VesselSpec, config: Any) -> VesselInputs:
        return VesselInputs()

    def physics(self, spec: VesselSpec, config: Any) -> Mapping[str, Any]:
        return {"identified": Identified()}

    def checks(self, spec: VesselSpec, log: Log) -> Sequence[types.Finding]:
        return ()

    def samples(self, spec: VesselSpec, config: Any, logs: Sequence[Log], groups: Sequence[Index]) -> Samples:
        return types.joined_samples([self._samples(config, *own) for own in zip(logs, groups, strict=True)])

    def _samples(self, config: Any, log: Log, group: Index) -> Samples:
        found = smooth(log.t, log["position"], config.data.cutoff_hz)
        for name, values in zip(STATES, (found.value, found.first, found.second), strict=True):
            log = log.put(CHANNELS[name], values)
        log = log.put(CHANNELS["command"], smooth(log.t, log["command"], config.data.cutoff_hz).value)
        rows = np.arange(10, len(log) - 10, config.data.every)
        every = np.ones((len(rows), 2), dtype=np.bool_)
        return Samples(log.take(rows), group[rows], every, every)

    def robot(self, spec: VesselSpec, config: Any) -> SimulatedVessel | None:
        return SimulatedVessel(spec) if spec.simulated else None

    def tests(self, spec: VesselSpec, config: Any, rng: np.random.Generator) -> Mapping[str, Trajectory]:
        speed, bend = np.full(2, spec.speed), np.full(2, spec.acceleration)
        return {"moves": random_moves(rng, np.array(spec.lower), np.array(spec.upper), speed, bend, 6)}

    def baselines(self, spec: VesselSpec, config: Any) -> Mapping[str, Controller | None]:
        return {"pd": None}

    def controller(self, spec: VesselSpec, config: Any, model: Model) -> Controller:
        return Feedforward(model, self.limit(spec))


KIND = VesselKind()
