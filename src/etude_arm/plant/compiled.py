"""The arm in closed form, compiled: equations of motion, motors, friction, encoder and PD loop in one file.

It is independent of MuJoCo and an order of magnitude faster; tests compare the two. All compiled code is in
this file, since numba's cache checks only the file of the cached function: a change of a callee elsewhere
would go unnoticed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from etude._runtime.compilation import compiled, compiled_part
from etude.types import Array
from etude_arm.plant.parameters import ArmParameters
from etude_arm.plant.trace import LoopInputs, Trace


class Arrays(NamedTuple):
    """ArmParameters as arrays for compiled code.

    Attributes:
        reach: (n, n) coefficient of the direction of link i in the centre of mass of link k.
        mass: (n,) kg.
        twist: (n,) inertia along minus inertia across each link.
        column: inertia about the vertical that does not depend on posture.
        coupling: (n, n) planar inertia coefficients; weight: (n,) gravity coefficients.
        pivots: (dof, 4) fixed and moving pivot (x, z), both seen from the joint; zeros on a hinge.
        motors: (dof, 17), the columns that `_motor` names.
        timestep: s.
    """

    reach: Array
    mass: Array
    twist: Array
    column: float
    coupling: Array
    weight: Array
    pivots: Array
    motors: Array
    timestep: float


def arrays(arm: ArmParameters) -> Arrays:
    """The constants of the equations of motion."""
    n = len(arm.links)
    reach = np.zeros((n, n))
    for k, link in enumerate(arm.links):
        reach[k, :k] = [before.length for before in arm.links[:k]]
        reach[k, k] = link.center
    mass = np.array([link.mass for link in arm.links])
    across = np.array([link.inertia_across for link in arm.links])
    along = np.array([link.inertia_along for link in arm.links])
    coupling = np.einsum("k,ki,kj->ij", mass, reach, reach) + np.diag(across)
    return Arrays(
        reach=reach,
        mass=mass,
        twist=along - across,
        column=arm.column_inertia + float(across.sum()),
        coupling=coupling,
        weight=arm.gravity * (mass @ reach),
        pivots=_pivots(arm),
        motors=np.array([_motor(arm, j) for j in range(n + 1)]),
        timestep=arm.timestep,
    )


def _pivots(arm: ArmParameters) -> Array:
    """Fixed and moving pivot seen from the joint, which is the shoulder or the end of the link before."""
    rows = np.zeros((len(arm.motors), 4))
    origins = [arm.shoulder, *((link.length, 0.0) for link in arm.links[:-1])]
    for j, (motor, origin) in enumerate(zip(arm.motors[1:], origins, strict=True), start=1):
        assert motor.fixed is not None
        assert motor.moving is not None
        rows[j] = [motor.fixed[0] - origin[0], motor.fixed[1] - origin[1], *motor.moving]
    return rows


def _motor(arm: ArmParameters, j: int) -> list[float]:
    motor = arm.motors[j]
    constant, resistance = motor.electrical(arm.controller.supply)
    cogging, ripple = motor.cogging, motor.friction_ripple
    return [
        *(constant / resistance, constant * constant / resistance, motor.gear, motor.armature, motor.viscous),
        *(motor.coulomb, motor.static, motor.stribeck, motor.stiffness, motor.micro_damping),
        *(cogging.amplitude, cogging.wavenumber, cogging.phase),
        *(ripple.amplitude, ripple.wavenumber, ripple.phase),
        0.0 if motor.fixed is None else 1.0,
    ]


@compiled_part
def _lever(q: float, pivot: Array, gear: float, linear: float) -> tuple[float, float, float]:
    """Actuator length, its derivative (the moment arm), and second derivative, at joint angle q."""
    if linear == 0.0:
        return gear * q, gear, 0.0
    c, s = np.cos(q), np.sin(q)
    mx, mz = c * pivot[2] - s * pivot[3], s * pivot[2] + c * pivot[3]
    rx, rz = mx - pivot[0], mz - pivot[1]
    length = np.sqrt(rx * rx + rz * rz)
    first = (mx * rz - mz * rx) / length  # r . dr/dq with dr/dq = (-mz, mx)
    second = (mx * mx + mz * mz - (rx * mx + rz * mz) - first * first) / length
    return gear * length, gear * first, gear * second


@compiled
def _rigid(q: Array, v: Array, p: Arrays, M: Array, bias: Array) -> None:
    """Inertia M (dof, dof) and Coriolis plus gravity forces bias (dof,) of the links, written in place."""
    n = p.mass.size
    angle, rate = np.cumsum(q[1:]), np.cumsum(v[1:])  # of each link against the horizontal
    cos, sin = np.cos(angle), np.sin(angle)
    waist, slope = p.column, np.zeros(n)  # inertia about the vertical and its derivative in the link angles
    force = np.zeros(n)  # in the link angles
    M[:] = 0.0
    bias[:] = 0.0
    for k in range(n):
        radius = 0.0
        for i in range(k + 1):
            radius += p.reach[k, i] * cos[i]
        waist += p.mass[k] * radius * radius + p.twist[k] * sin[k] * sin[k]
        slope[k] += 2.0 * p.twist[k] * sin[k] * cos[k]
        for i in range(k + 1):
            slope[i] -= 2.0 * p.mass[k] * radius * p.reach[k, i] * sin[i]
    M[0, 0] = waist
    for i in range(n):
        force[i] = p.weight[i] * cos[i] - 0.5 * slope[i] * v[0] * v[0]
        bias[0] += slope[i] * rate[i] * v[0]
        for j in range(n):
            entry = p.coupling[i, j] * (cos[i] * cos[j] + sin[i] * sin[j])
            force[i] += p.coupling[i, j] * (sin[i] * cos[j] - cos[i] * sin[j]) * rate[j] * rate[j]
            for a in range(i + 1):  # joint a turns every link from a on
                for b in range(j + 1):
                    M[a + 1, b + 1] += entry
        for a in range(i + 1):
            bias[a + 1] += force[i]


@compiled_part
def _friction_level(length: float, speed: float, m: Array) -> float:
    """LuGre's g(v), between static and Coulomb friction, times the ripple along the travel."""
    level = 1.0 + m[13] * np.sin(m[14] * length + m[15])
    return float(level * (m[5] + (m[6] - m[5]) * np.exp(-((speed / m[7]) ** 2))))


@compiled_part
def _solve(M: Array, x: Array) -> None:
    """x = M^-1 x for symmetric positive definite M, both overwritten (Cholesky without a square root)."""
    n = x.size
    for j in range(n):
        for i in range(j + 1, n):
            factor = M[i, j] / M[j, j]
            for k in range(j, n):
                M[i, k] -= factor * M[j, k]
            x[i] -= factor * x[j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= M[i, k] * x[k]
        x[i] /= M[i, i]


@compiled_part
def _step(q: Array, v: Array, z: Array, volts: Array, p: Arrays, M: Array, f: Array) -> None:
    """One semi-implicit step of angles q, rates v, bristle deflections z (all (dof,), in place).

    Damping, back-EMF and the bristles' damping are implicit, everything else explicit; the bristles follow
    their exponential solution for constant speed. M and f are work space.
    """
    h = p.timestep
    _rigid(q, v, p, M, f)
    for j in range(q.size):
        m = p.motors[j]
        length, arm, arm_slope = _lever(q[j], p.pivots[j], m[2], m[16])
        speed = arm * v[j]
        relax = -m[8] * abs(speed) / _friction_level(length, speed, m)
        bristle_rate = speed + relax * z[j]
        drive = m[0] * volts[j] - m[1] * speed + m[10] * np.sin(m[11] * length + m[12])
        total = drive - m[8] * z[j] - m[9] * bristle_rate - m[4] * speed
        f[j] = arm * (total - m[3] * arm_slope * v[j] * v[j]) - f[j]
        M[j, j] += arm * arm * (m[3] + h * (m[1] + m[4] + m[9]))
        if relax != 0.0:
            decay = np.exp(relax * h)
            z[j] = decay * z[j] + speed * (decay - 1.0) / relax
        else:
            z[j] += h * speed
    _solve(M, f)
    for j in range(q.size):
        v[j] += h * f[j]
        q[j] += h * v[j]


@compiled
def _open_loop(q: Array, v: Array, z: Array, volts: Array, p: Arrays) -> tuple[Array, Array, Array]:
    steps, dof = volts.shape
    M, f = np.zeros((dof, dof)), np.zeros(dof)
    qs, vs, zs = np.empty((steps, dof)), np.empty((steps, dof)), np.empty((steps, dof))
    for k in range(steps):
        _step(q, v, z, volts[k], p, M, f)
        qs[k], vs[k], zs[k] = q, v, z
    return qs, vs, zs


class LoopState(NamedTuple):
    """State of the arm and its controller between two control ticks; `_closed_loop` changes it in place.

    Attributes:
        q, v, z: (dof,) angles rad, rates rad/s, bristle deflections.
        before, rate: (dof,) the controller's last measured position, and its filtered difference.
        ticks: (1,) control ticks since the start; at the first there is no difference yet.
    """

    q: Array
    v: Array
    z: Array
    before: Array
    rate: Array
    ticks: NDArray[np.int64]


@compiled
def _closed_loop(
    state: LoopState,
    q_des: Array,
    qd_des: Array,
    tau_ff: Array,
    noise: Array,
    kp: Array,
    kd: Array,
    p: Arrays,
    substeps: int,
    resolution: float,
    supply: float,
    tick: float,
    share: float,
) -> tuple[Array, Array, Array, Array]:
    ticks, dof = q_des.shape
    q, v, z, before, rate = state.q, state.v, state.z, state.before, state.rate
    M, f, volts = np.zeros((dof, dof)), np.zeros(dof), np.zeros(dof)
    measured, true = np.empty((ticks, dof)), np.empty((ticks, dof))
    tau, tau_fb = np.empty((ticks, dof)), np.empty((ticks, dof))
    period = substeps * p.timestep
    for k in range(ticks):
        for j in range(dof):
            true[k, j] = q[j]
            measured[k, j] = np.rint((q[j] + noise[k, j]) / tick) * tick
            if state.ticks[0] > 0:
                rate[j] += share * ((measured[k, j] - before[j]) / period - rate[j])
            before[j] = measured[k, j]
            tau_fb[k, j] = kp[j] * (q_des[k, j] - measured[k, j]) + kd[j] * (qd_des[k, j] - rate[j])
            command = np.rint(tau_fb[k, j] + tau_ff[k, j])
            tau[k, j] = min(max(command, -resolution), resolution)
            volts[j] = tau[k, j] / resolution * supply
        for _ in range(substeps):
            _step(q, v, z, volts, p, M, f)
        state.ticks[0] += 1
    return measured, true, tau, tau_fb


@compiled
def _inverse(q: Array, qd: Array, qdd: Array, p: Arrays) -> Array:
    """Motor voltage (T, dof) for a motion with friction at its steady state."""
    count, dof = q.shape
    M, bias, volts = np.zeros((dof, dof)), np.zeros(dof), np.empty((count, dof))
    for k in range(count):
        _rigid(q[k], qd[k], p, M, bias)
        for j in range(dof):
            m = p.motors[j]
            length, arm, arm_slope = _lever(q[k, j], p.pivots[j], m[2], m[16])
            speed = arm * qd[k, j]
            load = bias[j]
            for i in range(dof):
                load += M[j, i] * qdd[k, i]
            rotor = m[3] * (arm * qdd[k, j] + arm_slope * qd[k, j] * qd[k, j])
            friction = np.sign(speed) * _friction_level(length, speed, m) + m[4] * speed
            cogging = m[10] * np.sin(m[11] * length + m[12])
            volts[k, j] = (load / arm + rotor + friction - cogging + m[1] * speed) / m[0]
    return volts


def open_loop(arm: ArmParameters, q: Array, v: Array, z: Array, volts: Array) -> tuple[Array, Array, Array]:
    """Motion under given voltages, one row of volts (steps, dof) per physics step.

    Args:
        q, v, z: (dof,) initial angles rad, rates rad/s, bristle deflections in each motor's unit of length.

    Returns:
        angles, rates, deflections after each step, (steps, dof) each.
    """
    start = (np.array(x, dtype=np.float64) for x in (q, v, z))
    q0, v0, z0 = start
    motion: tuple[Array, Array, Array] = _open_loop(q0, v0, z0, np.ascontiguousarray(volts), arrays(arm))
    return motion


def at_rest(q: Array) -> LoopState:
    """The state before the first control tick: at rest at the angles q (dof,)."""
    v, z, before, rate = np.zeros((4, len(q)))
    return LoopState(np.array(q, dtype=np.float64), v, z, before, rate, np.zeros(1, dtype=np.int64))


class Constants(NamedTuple):
    """Inputs of the compiled loop for an arm and its controller, made once."""

    kp: Array
    kd: Array
    arm: Arrays
    resolution: float
    supply: float
    tick: float
    share: float


def constants(arm: ArmParameters) -> Constants:
    """The inputs for the arm with these parameters."""
    c = arm.controller
    return Constants(
        kp=np.array(c.kp),
        kd=np.array(c.kd),
        arm=arrays(arm),
        resolution=float(c.resolution),
        supply=c.supply,
        tick=c.encoder_tick,
        share=c.velocity_filter,
    )


def advance(arm: Constants, state: LoopState, inputs: LoopInputs) -> Trace:
    """The closed loop over the control ticks of `inputs`, from `state`, which is updated."""
    measured, true, tau, tau_fb = _closed_loop(
        state,
        inputs.q_des,
        inputs.qd_des,
        inputs.tau_ff,
        inputs.noise,
        arm.kp,
        arm.kd,
        arm.arm,
        inputs.substeps,
        arm.resolution,
        arm.supply,
        arm.tick,
        arm.share,
    )
    return Trace(q=measured, q_true=true, tau=tau, tau_fb=tau_fb)


def simulate(arm: ArmParameters, inputs: LoopInputs) -> Trace:
    """The closed loop over all control ticks, from rest at the first desired position."""
    return advance(constants(arm), at_rest(inputs.q_des[0]), inputs)


def inverse(arm: ArmParameters, q: Array, qd: Array, qdd: Array) -> Array:
    """Command (T, dof) that produces a motion (T, dof each), neither rounded nor clipped."""
    rows = (np.ascontiguousarray(x, dtype=np.float64) for x in (q, qd, qdd))
    volts: Array = _inverse(*rows, arrays(arm))
    return volts / arm.controller.supply * arm.controller.resolution


class RunningArm:
    """One arm that runs step by step (implements `trace.Running`), bit for bit as a whole run.

    Args:
        arm: its parameters.
        q: (dof,) angles at rest, rad.
    """

    def __init__(self, arm: ArmParameters, q: Array) -> None:
        self._state = at_rest(q)
        self.change(arm)

    def change(self, parameters: ArmParameters) -> None:
        """From the next tick on the arm has these parameters; angles, rates and bristles stay."""
        self._arm = constants(parameters)

    def advance(self, inputs: LoopInputs) -> Trace:
        """Continues over the ticks of `inputs`."""
        return advance(self._arm, self._state, inputs)
