"""Flight parameters: estimates of a vehicle's physical constants, as settings of an autopilot
(`Kind.parameters`).

    f_z = k sum t(w) + b v_z sum w + c (v_x^2 + v_y^2),   t(w) = f w^2 + (1 - f) w

with f_z the specific force along the body's z axis, w the motors' commands behind a lag and a delay, and f
the thrust curve, PX4's THR_MDL_FAC. Moments give the centre of mass; drag is the lateral force.

Errors of flights are correlated, so the deviations of least squares are too small. Intervals are from a
delete-one-block jackknife: all is estimated again without each block of `BLOCK_S`. Logs that are long enough
are also estimated separately. If they contradict each other, their ratio widens the intervals (Birge, Phys.
Rev. 40, 1932).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from etude.logs.cleaning.filters import median_rate
from etude.logs.readers.cells import text_cell
from etude.types import Array, Delivered, Index, Log, Mask
from etude_quadrotor.recorder import on_even_grid, with_states
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import GRAVITY

BLOCK_S = 5.0
"""s: a stretch of a flight that is left out as a whole; errors of a flight are correlated over less."""
LEAST_BLOCKS = 6
"""Least number of blocks for an interval."""
CHANCE = 0.01
"""Probability that the test finds a contradiction between consistent logs; on a contradiction their spread
widens the intervals.
"""
LAGS, DELAYS = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12), (-0.004, 0.0, 0.004, 0.008, 0.016, 0.032)
"""s: grid of lags and delays at the start of the search."""
FASTEST_LAG, STEPS, STEP_S = 0.002, 12, 1e-4
"""Least lag of a motor, s; largest number of Gauss-Newton steps; step of their differences, s."""
SETTLED_S = 0.5
"""s at a log's start that are excluded, since commands before the log still act."""
FAST_HZ = 50.0
"""Least rate of a log from which a lag can be identified, Hz."""
DENSITY = 1.225
"""kg/m^3 of air, as PX4's EKF2_BCOEF has it."""
FULL = 65535
"""A Crazyflie's motor at full scale."""
CONTROL_HZ = 500.0
"""Hz of a Crazyflie's rate control, of which its INDI parameters are."""
CANNOT = "cannot tell"
LOW, SPAN, LEAST_HEIGHT, EVEN = 4.0, 0.25, 0.1, 1e-3
"""Height, in distances of the outermost rotor from the centre, below which rows are excluded; default of that
distance, m; height that keeps 1/h^2 finite, m; relative variation of it in flights at one height.
"""


@dataclass(frozen=True, eq=False)
class Flights:
    """Rows of all flights in sequence; commands as fractions of their range, before their lag.

    Attributes:
        commands: (N_i, n) of each flight, on an even grid of step (s). step: duration of each flight in s.
        force: (N, 3) specific force, m/s^2. rates: (N, 3) rad/s. turning: (N, 3) rad/s^2.
        velocity: (N, 3) of the body, m/s, or None. height: (N,) m above ground, or None.
        block: (N,) number of each row's block, -1 for unused rows. log: (N,) number of its log.
    """

    commands: tuple[Array, ...]
    step: tuple[float, ...]
    force: Array
    rates: Array
    turning: Array
    velocity: Array | None
    height: Array | None
    block: Index
    log: Index

    @property
    def used(self) -> Mask:
        """Mask (N,) of the used rows."""
        return self.block >= 0

    @cached_property
    def blocks(self) -> list[int]:
        """Numbers of the blocks with rows."""
        return [int(number) for number in np.unique(self.block[self.used])]

    @cached_property
    def long(self) -> list[list[int]]:
        """The blocks of each log that has enough of them."""
        each = [np.unique(self.block[self.used & (self.log == i)]).tolist() for i in range(len(self.step))]
        return [blocks for blocks in each if len(blocks) >= LEAST_BLOCKS]

    def lagged(self, lag: float, delay: float) -> Array:
        """Commands (N, n) behind a first-order lag and a delay, s."""
        pairs = zip(self.commands, self.step, strict=True)
        return np.concatenate([_lagged(commands, step, lag, delay) for commands, step in pairs])


def _lagged(commands: Array, step: float, lag: float, delay: float) -> Array:
    """Exact for commands that hold from row to row."""
    from scipy.signal import lfilter, lfilter_zi

    whole = int(np.floor(delay / step))
    rows = np.clip(np.arange(len(commands)) - whole, 0, len(commands) - 1)
    decay, new = np.exp(-step / lag), np.exp((delay - (whole + 1) * step) / lag)
    b, a = [0.0, 1.0 - new, new - decay], [1.0, -decay]
    start = lfilter_zi(b, a)[:, None] * commands[:1]
    return np.asarray(lfilter(b, a, commands[rows], axis=0, zi=start)[0])


def flights_of(spec: QuadrotorSpec, logs: Sequence[Log]) -> Flights:
    """The rows of all logs; a state that one log lacks is left out for all."""
    prepared = [with_states(on_even_grid(log)) for log in logs]
    low, high = np.array(spec.command_lower), np.array(spec.command_upper)
    blocks, number = [], 0
    for log in prepared:
        t = log.t - log.t[0]
        count = max(1, round((t[-1] - SETTLED_S) / BLOCK_S))
        block = np.floor((t - SETTLED_S) / (t[-1] - SETTLED_S + 1e-9) * count).astype(np.int64)
        used = block >= 0
        if "altitude" in log:
            used &= log["altitude"][:, 0] > near_ground(spec)
        blocks.append(np.where(used, block + number, -1))
        number += count
    moving, high_up = (all(name in log for log in prepared) for name in ("body_velocity", "altitude"))

    def joined(name: str) -> Array:
        return np.concatenate([log[name] for log in prepared])

    return Flights(
        tuple(uncurved((log["command"] - low) / (high - low), spec.thrust_curve) for log in prepared),
        tuple(1.0 / median_rate(log.t) for log in prepared),
        joined("specific_force"),
        joined("rates"),
        joined("angular_acceleration"),
        joined("body_velocity") if moving else None,
        joined("altitude")[:, 0] if high_up else None,
        np.concatenate(blocks),
        np.repeat(np.arange(len(prepared)), [len(log) for log in prepared]),
    )


def near_ground(spec: QuadrotorSpec) -> float:
    """Height below which the ground effect exceeds a power law of the height, m."""
    span = max((float(np.hypot(x, y)) for x, y, _ in spec.rotors), default=SPAN)
    return LOW * span


def uncurved(command: Array, curve: float) -> Array:
    """Output of a driver for a command: u with curve u^2 + (1 - curve) u = command."""
    if curve == 0.0:
        return command
    half = (1.0 - curve) / (2.0 * curve)
    return np.asarray(np.sqrt(half**2 + np.maximum(command, 0.0) / curve) - half)


def curved(u: Array, curve: Array | float) -> Array:
    """curve u^2 + (1 - curve) u."""
    return np.asarray(curve * u**2 + (1.0 - curve) * u)


NAMES = (
    "hover",
    "curve",
    "hover_curved",
    "lag",
    "centre_x",
    "centre_y",
    "rotor_drag_x",
    "rotor_drag_y",
    "body_drag_x",
    "body_drag_y",
)
"""What is estimated, NaN where flights lack what it takes: hover thrust as flown; thrust curve; hover thrust
under that curve; lag, s; centre of mass, m; drag of rotors at hover, 1/s, and of the body, 1/m.
"""


@dataclass(frozen=True, eq=False)
class Timed:
    """The fit of the thrust to all rows.

    Attributes:
        lag, delay: s. w: (N, n) commands behind both.
        slopes: (N, 2) of the specific force along z in lag and delay, m/s^3.
    """

    lag: float
    delay: float
    w: Array
    slopes: Array


def _thrust(flights: Flights, w: Array) -> Array:
    """Columns (N, p) whose sum is the specific force along z."""
    columns = [(w**2).sum(axis=1), w.sum(axis=1)]
    if flights.velocity is not None:
        v = flights.velocity
        columns += [v[:, 2] * columns[1], v[:, 0] ** 2 + v[:, 1] ** 2]
        columns.append(v[:, 2] * np.linalg.norm(v, axis=1))
    if flights.height is not None:
        # Cheeseman and Bennett 1955: thrust grows by a part that goes with 1/h^2, here about its average,
        # since flights at one height cannot tell it from the thrust
        near = np.maximum(flights.height, LEAST_HEIGHT) ** -2
        mean = near[flights.used].mean()
        if np.ptp(near[flights.used]) > EVEN * mean:
            columns.append(columns[0] * (near - mean))
    return np.column_stack(columns)


def _solved(X: Array, y: Array) -> Array:
    """Least squares (p,) with columns of any size."""
    size = np.sqrt(np.mean(X**2, axis=0)) + 1e-300  # of a column of zeros
    return np.asarray(np.linalg.lstsq(X / size, y, rcond=None)[0] / size)


def timed(flights: Flights) -> Timed:
    """Lag and delay with which the commands explain the thrust best: from a grid, then Gauss-Newton."""
    used, y = flights.used, flights.force[:, 2]

    def left(lag: float, delay: float) -> float:
        X = _thrust(flights, flights.lagged(lag, delay))[used]
        return float(np.mean((y[used] - X @ _solved(X, y[used])) ** 2))

    _, lag, delay = min((left(a, b), a, b) for a in LAGS for b in DELAYS)
    for _ in range(STEPS):
        fit = _at(flights, lag, delay)
        step = _solved(np.hstack([_thrust(flights, fit.w), fit.slopes])[used], y[used])[-2:]
        step = np.clip(step, -0.5 * lag, 0.5 * lag)
        lag, delay = max(FASTEST_LAG, lag + float(step[0])), delay + float(step[1])
        if np.abs(step).max() < 1e-6:
            break
    return _at(flights, lag, delay)


def _at(flights: Flights, lag: float, delay: float) -> Timed:
    w, used = flights.lagged(lag, delay), flights.used
    weights = _solved(_thrust(flights, w)[used], flights.force[used, 2])
    slopes = []
    for more in ((STEP_S, 0.0), (0.0, STEP_S)):
        ends = [
            _thrust(flights, flights.lagged(lag + sign * more[0], delay + sign * more[1])) @ weights
            for sign in (1.0, -1.0)
        ]
        slopes.append((ends[0] - ends[1]) / (2.0 * STEP_S))
    return Timed(lag, delay, w, np.column_stack(slopes))


def estimates(spec: QuadrotorSpec, flights: Flights, fit: Timed, rows: Mask) -> Array:
    """Values (P,) of NAMES from some of the rows."""
    values = dict.fromkeys(NAMES, np.nan)
    w, force = fit.w[rows], flights.force[rows]
    columns = _thrust(flights, fit.w)[rows]
    weights = _solved(np.hstack([columns, fit.slopes[rows]]), force[:, 2])
    square, plain = weights[:2]
    values["lag"] = fit.lag + weights[-2]
    values["curve"] = square / (square + plain)
    pattern = w.mean(axis=0) / w.mean()  # of the motors at trim
    a, b = square * (pattern**2).sum(), plain * pattern.sum()
    hover = 2.0 * GRAVITY / (b + np.sqrt(max(b * b + 4.0 * a * GRAVITY, 0.0)))
    values["hover"] = float(curved(hover * pattern, spec.thrust_curve).mean())
    # at the curve that can be set, which a curve below 0 is not
    values["hover_curved"] = float(curved(hover * pattern, _settable(values["curve"])).mean())
    velocity = None if flights.velocity is None else flights.velocity[rows]
    if velocity is not None:
        speed, spin = np.linalg.norm(velocity, axis=1), w.mean(axis=1) / hover
        for axis, name in enumerate("xy"):
            v = velocity[:, axis]
            X = np.column_stack([np.ones(len(v)), -v * spin, -v * speed])
            _, values[f"rotor_drag_{name}"], values[f"body_drag_{name}"] = _solved(X, force[:, axis])
    if spec.rotors:
        thrusts = curved(w, values["curve"])
        centre = _centre(spec, thrusts, flights.rates[rows], flights.turning[rows], velocity, w)
        values["centre_x"], values["centre_y"] = centre
    return np.array([values[name] for name in NAMES])


def _settable(curve: float) -> float:
    """The nearest value of THR_MDL_FAC."""
    return min(max(curve, 0.0), 1.0)


def _centre(
    spec: QuadrotorSpec, thrusts: Array, rates: Array, turning: Array, velocity: Array | None, w: Array
) -> tuple[float, float]:
    """Centre of mass (m) at which the moments of the thrusts are those of the measured rotation."""
    total, centre = thrusts.sum(axis=1), []
    for axis in (0, 1):
        other = 1 - axis  # thrust at x turns the body about y
        X = [total, turning[:, other], rates[:, 2] * rates[:, axis]]
        if velocity is not None:
            v = velocity[:, axis]
            X += [v * w.sum(axis=1), v * np.linalg.norm(velocity, axis=1)]
        places = np.array([rotor[axis] for rotor in spec.rotors])
        centre.append(float(_solved(np.column_stack(X), thrusts @ places)[0]))
    return centre[0], centre[1]


def intervals(spec: QuadrotorSpec, flights: Flights) -> tuple[Array, Array]:
    """Value, lower and upper end (P, 3) of the 95 % interval of NAMES, and (P,) the factor by which
    contradicting logs widen it.
    """
    from scipy.stats import t as student

    fit, K = timed(flights), len(flights.blocks)
    value, deviation = _jackknifed(spec, flights, fit, flights.blocks)
    factor = np.ones(len(NAMES))
    if len(flights.long) > 1:
        each = [_jackknifed(spec, flights, fit, blocks) for blocks in flights.long]
        factor = contradiction(*(np.array(part) for part in zip(*each, strict=True)))
    half = float(student.ppf(0.975, K - 1)) * deviation * factor
    return np.column_stack([value, value - half, value + half]), factor


def _jackknifed(
    spec: QuadrotorSpec, flights: Flights, fit: Timed, blocks: Sequence[int]
) -> tuple[Array, Array]:
    """Values (P,) from these blocks, and their deviations when each block is left out."""
    rows, K = np.isin(flights.block, blocks), len(blocks)
    value = estimates(spec, flights, fit, rows)
    without = np.array([estimates(spec, flights, fit, rows & (flights.block != k)) for k in blocks])
    return value, np.sqrt((K - 1) / K * np.sum((without - without.mean(axis=0)) ** 2, axis=0))


def contradiction(values: Array, deviations: Array) -> Array:
    """Birge's ratio (P,) of logs with values (L, P), where it exceeds chance; else 1."""
    from scipy.stats import chi2

    weights = deviations**-2.0
    mean = np.sum(weights * values, axis=0) / np.sum(weights, axis=0)
    square, free = np.sum(weights * (values - mean) ** 2, axis=0), len(values) - 1
    beyond = square > float(chi2.ppf(1.0 - CHANCE, free))
    return np.where(beyond, np.sqrt(square / free), 1.0)


@dataclass(frozen=True)
class _Row:
    """Text and bounds of a value of NAMES.

    Attributes:
        label, unit: for people. widest: largest half interval, relative, or in the unit if `absolute`.
        lacking: reason why flights may not determine it. step: way to determine it.
    """

    label: str
    unit: str
    widest: float
    lacking: str
    step: str
    absolute: bool = False


UP_AND_DOWN = "fly with more motion up and down"
NO_VELOCITY = "some logs have neither position nor velocity, or no attitude"
NO_ROTORS = "robot.toml does not state the positions of its rotors (rotors = [[x, y, spin], ...])"
SLOW = f"a log has less than {FAST_HZ:g} rows a second"
FASTER = "fly faster sideways"
SHAKE = "to separate a lag from a delay, fly 15 s of fast vertical motion: 3 m/s^2 at 0.5 to 1.5 Hz"
ROWS: Mapping[str, _Row] = {
    "hover": _Row("hover thrust", "1", 0.1, "", UP_AND_DOWN),
    "curve": _Row("thrust curve", "1", 0.2, "", UP_AND_DOWN, absolute=True),
    "hover_curved": _Row("hover thrust with that curve", "1", 0.1, "", UP_AND_DOWN),
    "lag": _Row("motor time constant", "s", 0.15, SLOW, SHAKE),
    "centre_x": _Row("centre of mass x", "m", 0.01, NO_ROTORS, "fly longer", absolute=True),
    "centre_y": _Row("centre of mass y", "m", 0.01, NO_ROTORS, "fly longer", absolute=True),
    "rotor_drag_x": _Row("rotor drag x", "1/s", 0.5, NO_VELOCITY, FASTER),
    "rotor_drag_y": _Row("rotor drag y", "1/s", 0.5, NO_VELOCITY, FASTER),
    "body_drag_x": _Row("body drag x", "1/m", 0.5, NO_VELOCITY, FASTER),
    "body_drag_y": _Row("body drag y", "1/m", 0.5, NO_VELOCITY, FASTER),
}


@dataclass(frozen=True)
class Parameter:
    """A constant of a vehicle with its 95 % interval.

    Attributes:
        name, unit: such as "hover thrust", "1".
        value, lower, upper: in that unit; None if flights do not determine it.
        known: "measured", or "cannot tell" with the reason.
        settings: name of a parameter in an autopilot -> its value, as text.
    """

    name: str
    unit: str
    value: float | None = None
    lower: float | None = None
    upper: float | None = None
    known: str = "measured"
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def set(self) -> str:
        """The settings in words."""
        return "; ".join(f"{name} = {value}" for name, value in self.settings.items())

    def row(self) -> dict[str, Any]:
        """Values for tables."""
        values = {"parameter": self.name, "value": self.value, "lower": self.lower, "upper": self.upper}
        return values | {"unit": self.unit, "known": self.known, "set": self.set}

    def sentence(self) -> str:
        """A sentence for people."""
        if self.value is None:
            return f"{self.name}: {self.known}."
        unit = "" if self.unit == "1" else f" {self.unit}"
        text = f"{self.name} {self.value:.4g}{unit}, 95 % from {self.lower:.4g} to {self.upper:.4g}"
        return f"{text}: {self.set}." if self.set else f"{text}."


def report(spec: QuadrotorSpec, logs: Sequence[Log]) -> Delivered:
    """parameters.csv, parameters.json, and a sentence for each parameter."""
    estimated = parameters(spec, logs)
    rows = [parameter.row() for parameter in estimated]
    lines = [",".join(rows[0]), *(",".join(map(_cell, row.values())) for row in rows)]
    files = {
        "parameters.csv": ("\n".join(lines) + "\n").encode(),
        "parameters.json": (json.dumps(rows, indent=1) + "\n").encode(),
    }
    return Delivered(files, tuple(parameter.sentence() for parameter in estimated), {"parameters": rows})


def _cell(value: str | float | None) -> str:
    return text_cell(value) if isinstance(value, str) else "" if value is None else repr(value)


def parameters(spec: QuadrotorSpec, logs: Sequence[Log]) -> tuple[Parameter, ...]:
    """Each of NAMES with its 95 % interval and settings, or the reason why flights do not determine it."""
    flights = None if min(spec.command_lower) < 0.0 else flights_of(spec, logs)
    if flights is None:
        why = "commands are not motors"
    elif len(flights.blocks) < LEAST_BLOCKS:
        why = f"{LEAST_BLOCKS * BLOCK_S:g} s of flight above the ground are needed"
    else:
        why = ""
    bounds, factor = np.full((len(NAMES), 3), np.nan), np.ones(len(NAMES))
    if flights is not None and not why:
        bounds, factor = intervals(spec, flights)
        if max(flights.step) > 1.0 / FAST_HZ:
            bounds[NAMES.index("lag")] = np.nan
    rows = zip(NAMES, bounds, factor.tolist(), strict=True)
    return tuple(_parameter(spec, name, values, why, more) for name, values, more in rows)


def _parameter(spec: QuadrotorSpec, name: str, values: Array, why: str, factor: float) -> Parameter:
    value, lower, upper = values.tolist()
    row, half = ROWS[name], 0.5 * (upper - lower)
    if not why and np.isnan(value):
        why = row.lacking
    elif not why and not half <= row.widest * (1.0 if row.absolute else value):
        apart = f"logs contradict each other, which makes it {factor:.2g} times as wide"
        why = f"the interval is {value:.3g} +- {half:.2g}; {apart if factor > 1.0 else row.step}"
    if why:
        return Parameter(row.label, row.unit, known=f"{CANNOT}: {why}")
    return Parameter(row.label, row.unit, value, lower, upper, settings=_settings(spec, name, value))


def _settings(spec: QuadrotorSpec, name: str, value: float) -> dict[str, str]:
    """Parameters of PX4 and of a Crazyflie, and their values; of set-points that are parts of full scale."""
    if spec.command_unit != "1":
        return {}
    quad = len(spec.command_names) == 4
    settings: Mapping[str, dict[str, str]] = {
        "hover": {"MPC_THR_HOVER": f"{value:.3f}"}
        | ({"posCtlPid.thrustBase": f"{FULL * value:.0f}"} if quad else {}),
        "curve": {"THR_MDL_FAC": f"{_settable(value):.2f}"},
        "hover_curved": {"MPC_THR_HOVER": f"{value:.3f} with that THR_MDL_FAC"},
        "lag": {"ctrlINDI.act_dyn_p": f"{-np.expm1(-1.0 / (CONTROL_HZ * value)):.4f}"} if quad else {},
        # PX4's rotors are seen from the centre of mass, y to the right
        "centre_x": {"CA_ROTOR*_PX": f"CA_ROTOR*_PX {-value:+.4f}"},
        "centre_y": {"CA_ROTOR*_PY": f"CA_ROTOR*_PY {value:+.4f}"},
        "rotor_drag_x": {"EKF2_MCOEF": f"{value:.3f}"},
        "rotor_drag_y": {"EKF2_MCOEF": f"{value:.3f}"},
        "body_drag_x": {"EKF2_BCOEF_X": f"{0.5 * DENSITY / value:.1f}"},
        "body_drag_y": {"EKF2_BCOEF_Y": f"{0.5 * DENSITY / value:.1f}"},
    }
    return settings[name]
