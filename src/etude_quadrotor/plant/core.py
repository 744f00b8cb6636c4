"""Compiled simulation of a flight: motors, aerodynamics, rigid body, control and the loop over time.

All compiled code is here, since numba's cache checks only the file of the cached function.

State y (17,): position (world), velocity (world), quaternion world <- body (w, x, y, z), rates (body), four
rotor speeds. The four currents are kept apart: they are stiff, so they take exact exponential steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from etude._runtime.compilation import compiled, compiled_part
from etude_quadrotor.vehicle import GRAVITY, SPINS

Array = NDArray[np.float64]

OPEN_LOOP, VOLTAGES, SET_POINTS = 0, 1, 2
"""Source of the motor voltages: the plan alone; the cascade; or set-points that an inner loop follows."""
FLOWN, GROUND, LEFT_ROOM, DIVERGED = 0, 1, 2, 3
"""Why a flight ended."""
COLUMNS = 39
"""Of a trace: state (17), current (4), applied voltage (4), command (4), acceleration (3), angular
acceleration (3), wind (3), supply (1)."""
G = GRAVITY
S0, S1, S2, S3 = SPINS


class Body(NamedTuple):
    """The true vehicle.

    Attributes:
        mass: kg.
        inertia: (3, 3) with locked rotors, about the centre of mass.
        free_inverse: (3, 3) inverse of the inertia without the rotors' own spin.
        rotors: (4, 3) positions seen from the centre of mass, m.
        motors: (4, 6) kf, kq, Ke, R, L, Jr of each.
        drag: (3,) linear, N s/m; quadratic: N s^2/m^2.
        tilt, hub, inflow: of the rotor disc, each over the rotor's radius: see `derivative`.
        ground: (5,) rotor radius, distance of adjacent and of opposite axes, K_b, least height, m.
    """

    mass: float
    inertia: Array
    free_inverse: Array
    rotors: Array
    motors: Array
    drag: Array
    quadratic: float
    tilt: float
    hub: float
    inflow: float
    ground: Array


class Control(NamedTuple):
    """The controller, which knows the nominal vehicle only.

    Attributes:
        mode: OPEN_LOOP, VOLTAGES or SET_POINTS.
        hold: ticks between two runs of the position loop.
        mass, inertia (3,), mixer (4, 4): from thrust and moments to squared rotor speeds.
        motor: (4,) kq, Ke, R, largest voltage.
        position: (3, 3) rows P, D, I for x, y, z.
        clip: m/s^2; tilt: rad.
        attitude: (4,) P and D of roll and pitch, P and D of yaw, 1/s^2 and 1/s.
        full_scale: (3,) roll or pitch rad, yaw rate rad/s, thrust N that a command of 1 means.
    """

    mode: int
    hold: int
    mass: float
    inertia: Array
    mixer: Array
    motor: Array
    position: Array
    clip: float
    tilt: float
    attitude: Array
    full_scale: Array


@compiled
def ground_effect(z: float, p: Array) -> float:
    """Thrust near the ground over thrust far from it.

    Sanchez-Cuevas, Heredia and Ollero 2017 (doi:10.1155/2017/1823056), eq. (7): rotor, neighbours, the
    opposite rotor, and the lift of the body on the air that returns between the rotors (K_b).
    """
    r2, h = p[0] * p[0], max(z, p[4])
    a = p[1] * p[1]
    near, far, body = a + 4.0 * h * h, 2.0 * a + 4.0 * h * h, p[2] * p[2] + 4.0 * h * h
    loss = r2 / (16.0 * h * h) + r2 * h / (near * np.sqrt(near)) + 0.5 * r2 * h / (far * np.sqrt(far))
    return float(1.0 / (1.0 - loss - 2.0 * r2 * h * p[3] / (body * np.sqrt(body))))


@compiled_part
def _axes(y: Array) -> tuple[float, float, float, float, float, float, float, float, float]:
    """R_world_body of y's quaternion, row by row."""
    w, a, b, c = y[6], y[7], y[8], y[9]
    return (
        1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b - w * c), 2.0 * (a * c + w * b),
        2.0 * (a * b + w * c), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c - w * a),
        2.0 * (a * c - w * b), 2.0 * (b * c + w * a), 1.0 - 2.0 * (a * a + b * b),
    )  # fmt: skip


@compiled_part
def _times(M: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """M (3, 3) times a vector."""
    return (
        M[0, 0] * x + M[0, 1] * y + M[0, 2] * z,
        M[1, 0] * x + M[1, 1] * y + M[1, 2] * z,
        M[2, 0] * x + M[2, 1] * y + M[2, 2] * z,
    )


@compiled_part
def _rotors(
    y: Array, current: Array, vx: float, vy: float, vz: float, b: Body
) -> tuple[float, float, float, float, float, float, float]:
    """Force and moment of rotors and stators (body frame), and the rotors' spin, for a velocity in air.

    Blade flapping tilts the disc of a rotor back by tilt v / (R W). That bends its thrust and, through the
    stiffness of the hub, pitches the body. Inflow takes inflow v_z / (R W) of the thrust.
    """
    wx, wy, wz = y[10], y[11], y[12]
    fx = fy = fz = mx = my = mz = spin = 0.0
    ground = ground_effect(y[2], b.ground)
    for k in range(4):
        m, W, s = b.motors[k], y[13 + k], (S0 if k == 0 or k == 2 else S1)
        x, yy, z = b.rotors[k, 0], b.rotors[k, 1], b.rotors[k, 2]
        ux, uy, uz = vx + wy * z - wz * yy, vy + wz * x - wx * z, vz + wx * yy - wy * x
        strength = m[0] * ground * W
        tx, ty, tz = -strength * b.tilt * ux, -strength * b.tilt * uy, strength * (abs(W) - b.inflow * uz)
        fx, fy, fz = fx + tx, fy + ty, fz + tz
        mx += yy * tz - z * ty
        my += z * tx - x * tz
        mz += x * ty - yy * tx - s * m[2] * current[k]  # the stator feels the whole torque of the motor
        if b.hub != 0.0 and W > 1.0:
            mx += b.hub * uy / W
            my -= b.hub * ux / W
        spin += s * m[5] * W
    return fx, fy, fz, mx, my, mz, spin


@compiled
def derivative(y: Array, current: Array, wind: Array, noise: Array, b: Body, out: Array) -> None:
    """dy/dt into `out` for given currents; wind (3,) in the world; noise (6,) on both accelerations."""
    qw, qx, qy, qz, wx, wy, wz = y[6], y[7], y[8], y[9], y[10], y[11], y[12]
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = _axes(y)
    ax, ay, az = y[3] - wind[0], y[4] - wind[1], y[5] - wind[2]
    vx = r00 * ax + r10 * ay + r20 * az  # through the air, body frame
    vy = r01 * ax + r11 * ay + r21 * az
    vz = r02 * ax + r12 * ay + r22 * az
    fx, fy, fz, mx, my, mz, spin = _rotors(y, current, vx, vy, vz, b)
    quadratic = b.quadratic * np.sqrt(vx * vx + vy * vy + vz * vz)
    fx -= (b.drag[0] + quadratic) * vx
    fy -= (b.drag[1] + quadratic) * vy
    fz -= (b.drag[2] + quadratic) * vz
    hx, hy, hz = _times(b.inertia, wx, wy, wz)
    hz += spin  # Euler's equation; the rotors' share of it is the gyroscopic torque
    alpha = _times(b.free_inverse, mx - wy * hz + wz * hy, my - wz * hx + wx * hz, mz - wx * hy + wy * hx)
    for j in range(3):
        out[j] = y[3 + j]
        out[10 + j] = alpha[j] + noise[3 + j]
    out[3] = (r00 * fx + r01 * fy + r02 * fz) / b.mass + noise[0]
    out[4] = (r10 * fx + r11 * fy + r12 * fz) / b.mass + noise[1]
    out[5] = (r20 * fx + r21 * fy + r22 * fz) / b.mass - G + noise[2]
    out[6] = -0.5 * (qx * wx + qy * wy + qz * wz)
    out[7] = 0.5 * (qw * wx + qy * wz - qz * wy)
    out[8] = 0.5 * (qw * wy + qz * wx - qx * wz)
    out[9] = 0.5 * (qw * wz + qx * wy - qy * wx)
    for k in range(4):
        m, W, s = b.motors[k], y[13 + k], (S0 if k == 0 or k == 2 else S1)
        # W is the speed against the body, which turns as well
        out[13 + k] = (m[2] * current[k] - m[1] * W * abs(W)) / m[5] - s * out[12]


@compiled_part
def _currents(
    start: Array, y: Array, W: Array, slope: Array, volts: Array, t: float, b: Body, out: Array
) -> None:
    """Currents at time t of a step: L di/dt = V - R i - Ke W, exact for W + slope t; y serves L = 0."""
    for k in range(4):
        ke, resistance, inductance = b.motors[k, 2], b.motors[k, 3], b.motors[k, 4]
        if inductance == 0.0:
            out[k] = (volts[k] - ke * y[13 + k]) / resistance
            continue
        lag = ke * slope[k] * inductance / (resistance * resistance)
        first = (volts[k] - ke * W[k]) / resistance + lag
        out[k] = (
            first - ke * slope[k] * t / resistance + (start[k] - first) * np.exp(-t * resistance / inductance)
        )


@compiled_part
def _step(
    y: Array, i: Array, volts: Array, wind: Array, noise: Array, h: float, b: Body, work: Array
) -> None:
    """One step of y (17,) and i (4,), in place: Runge-Kutta of order 4 over currents known at its stages.

    On entry work[0] holds dy/dt at the start; the rows below are overwritten.
    """
    first, second, third, fourth, x = work[0], work[1], work[2], work[3], work[4]
    j, W, slope = work[5, :4], work[5, 4:8], work[5, 8:12]
    for k in range(4):
        W[k], slope[k] = y[13 + k], first[13 + k]
    for n in range(17):
        x[n] = y[n] + 0.5 * h * first[n]
    _currents(i, x, W, slope, volts, 0.5 * h, b, j)
    derivative(x, j, wind, noise, b, second)
    for n in range(17):
        x[n] = y[n] + 0.5 * h * second[n]
    _currents(i, x, W, slope, volts, 0.5 * h, b, j)
    derivative(x, j, wind, noise, b, third)
    for n in range(17):
        x[n] = y[n] + h * third[n]
    _currents(i, x, W, slope, volts, h, b, j)
    derivative(x, j, wind, noise, b, fourth)
    for n in range(17):
        # Runge-Kutta of fourth order; y: position, velocity, quaternion (6 to 9), rates, rotor speeds
        y[n] += h / 6.0 * (first[n] + 2.0 * (second[n] + third[n]) + fourth[n])
    length = np.sqrt(y[6] * y[6] + y[7] * y[7] + y[8] * y[8] + y[9] * y[9])
    for n in range(6, 10):
        y[n] /= length
    _currents(i, y, W, slope, volts, h, b, j)
    for k in range(4):
        i[k] = j[k]


@compiled_part
def _position_loop(
    y: Array, position: Array, velocity: Array, ff: Array, total: Array, period: float, c: Control, out: Array
) -> None:
    """PID on position, x y and z apart, -> out: unit direction of the thrust (world) and thrust, N.

    `total` (3,) is the integral of the error; it is frozen while its axis is clipped.
    """
    for j in range(3):
        error = position[j] - y[j]
        wish = c.position[j, 0] * error + c.position[j, 1] * (velocity[j] - y[3 + j]) + ff[j]
        step = error * period
        wish += c.position[j, 2] * (total[j] + step)
        if abs(wish) <= c.clip:
            total[j] += step
        out[j] = min(max(wish, -c.clip), c.clip)
    up = out[2] + G
    level = np.sqrt(out[0] * out[0] + out[1] * out[1])
    largest = np.tan(c.tilt) * up
    if level > largest:
        out[0] *= largest / level
        out[1] *= largest / level
    length = np.sqrt(out[0] * out[0] + out[1] * out[1] + up * up)
    upright = 1.0 - 2.0 * (y[7] * y[7] + y[8] * y[8])
    out[3] = c.mass * up / max(upright, 0.5)
    out[0], out[1], out[2] = out[0] / length, out[1] / length, up / length


@compiled_part
def _attitude_loop(y: Array, wish: Array, yaw_rate: float, c: Control, volts: Array) -> None:
    """PD on attitude and the static map of the nominal vehicle from thrust and moments to four voltages."""
    r00, r01, _, r10, r11, _, r20, r21, _ = _axes(y)
    ahead = r00 * wish[0] + r10 * wish[1] + r20 * wish[2]  # where the thrust shall go, body frame
    left = r01 * wish[0] + r11 * wish[1] + r21 * wish[2]
    mx = c.inertia[0] * (-c.attitude[0] * left - c.attitude[1] * y[10])
    my = c.inertia[1] * (c.attitude[0] * ahead - c.attitude[1] * y[11])
    turn = -c.attitude[2] * np.arctan2(r10, r00) if c.mode == VOLTAGES else 0.0
    mz = c.inertia[2] * (turn + c.attitude[3] * (yaw_rate - y[12]))
    for k in range(4):
        square = c.mixer[k, 0] * wish[3] + c.mixer[k, 1] * mx + c.mixer[k, 2] * my + c.mixer[k, 3] * mz
        square = max(square, 0.0)
        volts[k] = c.motor[2] * c.motor[0] * square / c.motor[1] + c.motor[1] * np.sqrt(square)


@compiled_part
def _set_points(y: Array, wish: Array, ff: Array, c: Control, command: Array) -> None:
    """Roll, pitch, yaw rate and thrust over their full scales, clipped; yaw is held at 0 by its rate."""
    yaw = np.arctan2(2 * (y[7] * y[8] + y[6] * y[9]), 1 - 2 * (y[8] * y[8] + y[9] * y[9]))
    ahead, left = np.cos(yaw) * wish[0] + np.sin(yaw) * wish[1], np.cos(yaw) * wish[1] - np.sin(yaw) * wish[0]
    command[0] = -np.arcsin(left) / c.full_scale[0]
    command[1] = np.arctan2(ahead, wish[2]) / c.full_scale[0]
    command[2] = -c.attitude[2] / c.attitude[3] * yaw / c.full_scale[1]
    command[3] = wish[3] / c.full_scale[2]
    for k in range(4):
        command[k] = min(max(command[k] + ff[k], -1.0 if k < 3 else 0.0), 1.0)


@compiled_part
def _desired_thrust(y: Array, command: Array, c: Control, out: Array) -> None:
    """Direction of the thrust (world) and thrust of the set-points, at the measured yaw."""
    yaw = np.arctan2(2 * (y[7] * y[8] + y[6] * y[9]), 1 - 2 * (y[8] * y[8] + y[9] * y[9]))
    roll, pitch = command[0] * c.full_scale[0], command[1] * c.full_scale[0]
    ahead, left = np.sin(pitch) * np.cos(roll), -np.sin(roll)
    out[0], out[1] = np.cos(yaw) * ahead - np.sin(yaw) * left, np.sin(yaw) * ahead + np.cos(yaw) * left
    out[2], out[3] = np.cos(pitch) * np.cos(roll), command[3] * c.full_scale[2]


@compiled_part
def _drive(y: Array, wish: Array, ff: Array, c: Control, command: Array, volts: Array) -> None:
    """Writes the motor voltages of this tick to `volts`; without set-points also to the command."""
    if c.mode == OPEN_LOOP:
        for k in range(4):
            volts[k] = command[k] = ff[k]
        return
    if c.mode == SET_POINTS:
        _desired_thrust(y, command, c, wish)
    _attitude_loop(y, wish, command[2] * c.full_scale[1] if c.mode == SET_POINTS else 0.0, c, volts)
    for k in range(4):
        voltage = volts[k] + (ff[k] if c.mode == VOLTAGES else 0.0)
        volts[k] = min(max(voltage, 0.0), c.motor[3])
        if c.mode == VOLTAGES:
            command[k] = volts[k]


@compiled
def ending(y: Array, room: Array, ground: float) -> int:
    """The reason why the flight ends in state y, or FLOWN; room (7,): corners and radius."""
    for n in range(17):
        if not np.isfinite(y[n]):
            return DIVERGED
    if y[2] <= ground:
        return GROUND
    for j in range(3):
        if y[j] < room[j] or y[j] > room[3 + j]:
            return LEFT_ROOM
    if y[0] * y[0] + y[1] * y[1] > room[6] * room[6]:
        return LEFT_ROOM
    return FLOWN


@compiled
def fly(
    plan: Array, ff: Array, air: Array, noise: Array, y0: Array, i0: Array, total: Array,
    h: float, b: Body, c: Control, room: Array, ground: float,
) -> tuple[Array, int]:  # fmt: skip
    """The flight, sample by sample.

    Args:
        plan: (T, 9) position, velocity, acceleration feedforward, world frame.
        ff: (T, 4) added to the command; in OPEN_LOOP the voltages.
        air: (T, 4) wind in the world, and the supply over its nominal value.
        noise: (T, 6) on acceleration (world) and angular acceleration (body).
        y0, i0, total: (17,), (4,), (3,) state, currents, integral of the position error at the start.
        h: step, s.
        room: (7,) corners and radius; ground: least height of the centre, m.

    Returns:
        (count, COLUMNS) trace up to the end, and why it ended.
    """
    steps = len(plan)
    y, i, total = y0.copy(), i0.copy(), total.copy()
    trace = np.empty((steps, COLUMNS))
    work, wish, command, volts = np.zeros((6, 17)), np.zeros(4), np.zeros(4), np.zeros(4)
    for k in range(steps):
        why = ending(y, room, ground)
        if why != FLOWN:
            return trace[:k].copy(), why
        if k % c.hold == 0 and c.mode != OPEN_LOOP:
            _position_loop(y, plan[k, :3], plan[k, 3:6], plan[k, 6:], total, h * c.hold, c, wish)
            if c.mode == SET_POINTS:
                _set_points(y, wish, ff[k], c, command)
        _drive(y, wish, ff[k], c, command, volts)
        for n in range(4):
            volts[n] *= air[k, 3]
        _currents(i, y, y[13:], work[0, 13:], volts, 0.0, b, i)
        derivative(y, i, air[k, :3], noise[k], b, work[0])
        for n in range(17):  # by loops: assignments of arrays compile the texts of their errors too
            trace[k, n] = y[n]
        for n in range(4):
            trace[k, 17 + n], trace[k, 21 + n] = i[n], volts[n]
            trace[k, 25 + n], trace[k, 35 + n] = command[n], air[k, n]
        for n in range(3):
            trace[k, 29 + n], trace[k, 32 + n] = work[0, 3 + n], work[0, 10 + n]
        _step(y, i, volts, air[k, :3], noise[k], h, b, work)
    return trace, FLOWN
