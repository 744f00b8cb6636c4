"""Differential flatness of a quadrotor: attitude, rates, angular acceleration and thrust from the motion of
its centre.

With rotor drag (Faessler, Franchi and Scaramuzza 2018), the body's acceleration is a = -g z + c z_B - R D R'
v, D = diag(dx, dy, dz) in 1/s. The heading is zero.

Jets contain complex-analytic functions alone, without moduli, so that a complex step through them is an exact
derivative.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.types import Array, Motion
from etude_quadrotor.vehicle import GRAVITY

Drag = tuple[float, float, float]

ORDERS = 5
"""Position, velocity, acceleration, jerk and snap."""
LEAST_LIFT = 0.3
"""Part of g that thrust, and its vertical part, may not fall below: the attitude is then well defined."""
LEAST_ANGLE = 0.1
"""Sine of the least angle between a + g z + dx v and the body's left axis of zero heading."""
STEP = 1e-30
"""Of the complex step: so small that the derivative is exact to rounding."""
VECTORS = ("specific_force", "rates", "angular_acceleration", "body_velocity", "body_acceleration")
"""The states that depend on more than the altitude, in the order of `_body`."""


@dataclass(frozen=True, eq=False)
class FlatMotion:
    """States and thrust with which a vehicle flies a motion.

    Attributes:
        motion: of its centre, orders (O, T, 3) with O >= 5.
        drag: (dx, dy, dz) 1/s, drag force per mass and speed along the body's axes.
        R_world_body: (T, 3, 3) columns x_B, y_B, z_B in the world frame.
        thrust: (T,) c, thrust per mass, m/s^2.
        states: for a model, by channel: (T, 3) each, the altitude (T, 1).
    """

    motion: Motion
    drag: Drag
    R_world_body: Array
    thrust: Array
    states: Mapping[str, Array]

    @cached_property
    def jacobian(self) -> Array:
        """Derivative (12, 15, T) of the 5 x 3 components of VECTORS in those of v, a, jerk and snap.

        A sample depends on its own derivatives alone, so one complex step per component serves all samples.
        All components pass through the formulas together. Rates are F(v, a) jerk + ..., so the angular
        acceleration is F(v, a) snap + ...: the other steps already contain the last three.
        """
        inputs = np.repeat(_stacked(self.motion)[:, None].astype(complex), 9, axis=1)
        inputs[np.arange(9), np.arange(9)] += 1j * STEP
        derivative = np.zeros((12, 3 * len(VECTORS), len(self.thrust)))
        derivative[:9] = (
            np.swapaxes(np.stack([part.imag for part in _body(inputs, self.drag)[2]]), 0, 1) / STEP
        )
        derivative[9:, 6:9] = derivative[6:9, 3:6]
        return derivative

    def vjp(self, gradient: Mapping[str, Array]) -> Array:
        """Gradient (O, T, 3), in the motion, of a function of the states.

        Args:
            gradient: its derivative in the states by channel, of their shapes; a missing channel is 0.
        """
        out = np.zeros(self.motion.orders.shape)
        if "altitude" in gradient:
            out[0, :, 2] = gradient["altitude"][:, 0]
        none = np.zeros((3, len(self.thrust)))
        weights = np.concatenate([gradient[name].T if name in gradient else none for name in VECTORS])
        pulled = np.einsum("iot,ot->it", self.jacobian, weights)
        out[1:ORDERS] = pulled.reshape(ORDERS - 1, 3, -1).swapaxes(1, 2)
        return out


def flat_motion(motion: Motion, drag: Drag = (0.0, 0.0, 0.0), *, check: bool = True) -> FlatMotion:
    """Attitude, thrust and states along a motion.

    Args:
        motion: T samples of x, y, z with five orders or more.
        drag: (dx, dy, dz) 1/s; zeros for the thesis's drag-free attitude.
        check: refuse singular samples; False inside a search whose limits exclude them.

    Raises:
        UnsafeTrajectoryError: a sample without thrust direction, with a + g z + dx v along the body's left
            axis, or with less than 0.3 g of thrust or lift; it names the time and the value.
        UsageError: another number of axes or orders; drag that is not three finite numbers >= 0.
    """
    if len(drag) != 3 or not all(np.isfinite(d) and d >= 0.0 for d in drag):
        raise UsageError(f"drag must be three finite numbers >= 0 in 1/s, not {drag}")
    if motion.orders.shape[0] < ORDERS or motion.orders.shape[2] != 3:
        orders, _, axes = motion.orders.shape
        raise UsageError(f"a flight needs 3 axes and {ORDERS} orders of its motion, not {axes} and {orders}")
    inputs = _stacked(motion)
    if check:
        _check_direction(motion, drag)
    axes, thrust, body = _body(inputs, drag)
    if check:
        _refuse_below(motion.t, thrust, LEAST_LIFT * GRAVITY, "the thrust per mass is {value:.3g} m/s^2")
    # axes[k] holds the components of the k-th body axis: columns of R
    R_world_body = np.moveaxis(np.stack([np.stack(axis) for axis in axes]), (0, 1, 2), (2, 1, 0))
    states = {"altitude": motion.orders[0, :, 2:].copy()}
    for k, name in enumerate(VECTORS):
        states[name] = np.ascontiguousarray(np.stack(body[3 * k : 3 * k + 3], axis=-1))
    return FlatMotion(motion, drag, np.ascontiguousarray(R_world_body), np.asarray(thrust), states)


def roll_pitch_yaw(R_world_body: Array) -> Array:
    """(T, 3) angles z-y'-x'' of rotations (T, 3, 3), rad."""
    R = R_world_body
    roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
    pitch = np.arctan2(-R[:, 2, 0], np.hypot(R[:, 2, 1], R[:, 2, 2]))
    return np.column_stack([roll, pitch, np.arctan2(R[:, 1, 0], R[:, 0, 0])])


def _stacked(motion: Motion) -> Array:
    """(12, T) components of velocity, acceleration, jerk and snap."""
    return np.ascontiguousarray(motion.orders[1:ORDERS].swapaxes(1, 2).reshape(12, -1))


Values = NDArray[Any]  # real, or complex on a complex step


@dataclass(frozen=True)
class Jet:
    """f, f', f'' of a scalar; arrays of one shape, real or complex."""

    value: Values
    first: Values
    second: Values

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.value + other.value, self.first + other.first, self.second + other.second)

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.value - other.value, self.first - other.first, self.second - other.second)

    def __mul__(self, other: Jet) -> Jet:
        f, g = self, other
        second = f.second * g.value + 2.0 * f.first * g.first + f.value * g.second
        return Jet(f.value * g.value, f.first * g.value + f.value * g.first, second)

    def inverse_root(self) -> Jet:
        """f^(-1/2)."""
        value = 1.0 / np.sqrt(self.value)
        rate = -0.5 * value / self.value
        # second derivative of f^(-1/2): 3/4 f^(-5/2)
        bend = -1.5 * rate / self.value
        return Jet(value, rate * self.first, bend * self.first**2 + rate * self.second)


def unit(a: tuple[Jet, ...]) -> tuple[Jet, ...]:
    """a/|a|, by the root of the sum of squares."""
    square = a[0] * a[0]
    for part in a[1:]:
        square = square + part * part
    scale = square.inverse_root()
    return tuple(part * scale for part in a)


def dot(a: tuple[Values, ...], b: tuple[Values, ...]) -> Values:
    """Inner product of two vectors given by components."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _body(inputs: Values, drag: Drag) -> tuple[list[tuple[Values, ...]], Values, list[Values]]:
    """The body's axes, thrust per mass, and the 15 components of VECTORS, in the order of its names.

    `inputs` (12, ...) are the components of velocity, acceleration, jerk and snap, real or complex.
    """
    v = tuple(Jet(inputs[i], inputs[3 + i], inputs[6 + i]) for i in range(3))
    a = tuple(Jet(inputs[3 + i], inputs[6 + i], inputs[9 + i]) for i in range(3))
    alpha, beta = _pushed(a, v, drag[0]), _pushed(a, v, drag[1])
    zero = Jet(*(np.zeros_like(inputs[0]) for _ in range(3)))
    # Faessler et al. 2018 with heading 0, y_C = (0, 1, 0): x_B = y_C x alpha/|.| = (p, 0, -q),
    # y_B = beta x x_B/|.|, z_B = x_B x y_B
    p, q = unit((alpha[2], alpha[0]))
    y_B = unit((zero - beta[1] * q, beta[2] * p + beta[0] * q, zero - beta[1] * p))
    frame = ((p, zero, zero - q), y_B, (q * y_B[1], zero - q * y_B[0] - p * y_B[2], p * y_B[1]))
    x, y, z = (tuple(part.value for part in axis) for axis in frame)
    x1, y1, z1 = (tuple(part.first for part in axis) for axis in frame)
    x2, y2, z2 = (tuple(part.second for part in axis) for axis in frame)
    # R' = R [w]: w = (z.y', x.z', y.x'); its derivative follows by the product rule
    rates = [dot(z, y1), dot(x, z1), dot(y, x1)]
    turned = [dot(z1, y1) + dot(z, y2), dot(x1, z1) + dot(x, z2), dot(y1, x1) + dot(y, x2)]
    velocity = tuple(part.value for part in v)
    acceleration = tuple(part.value for part in a)
    force = (acceleration[0], acceleration[1], acceleration[2] + GRAVITY)
    axes = [x, y, z]
    specific, in_body, moved = ([dot(axis, u) for axis in axes] for u in (force, velocity, acceleration))
    thrust = specific[2] + drag[2] * in_body[2]  # c = z_B'(a + g z + dz v)
    return axes, thrust, [*specific, *rates, *turned, *in_body, *moved]


def _pushed(a: tuple[Jet, ...], v: tuple[Jet, ...], drag: float) -> tuple[Jet, Jet, Jet]:
    """a + g z + d v as jets."""
    parts = [
        Jet(f.value + drag * u.value, f.first + drag * u.first, f.second + drag * u.second)
        for f, u in zip(a, v, strict=True)
    ]
    return parts[0], parts[1], Jet(parts[2].value + GRAVITY, parts[2].first, parts[2].second)


def _check_direction(motion: Motion, drag: Drag) -> None:
    """Raises UnsafeTrajectoryError at samples whose attitude is undefined, or nearly so."""
    least = LEAST_LIFT * GRAVITY
    up = np.array([0.0, 0.0, GRAVITY])
    for d in drag[:2]:
        force = motion.orders[2] + up + d * motion.orders[1]
        size = np.linalg.norm(force, axis=1)
        # a thousandth of the least lift: less than that is rounding, which has no direction
        _refuse_below(
            motion.t,
            size,
            1e-3 * least,
            "a + g z + d v is {value:.3g} m/s^2: thrust has no direction",
        )
        sideways = np.hypot(force[:, 0], force[:, 2]) / size
        text = "a + g z + d v lies along the body's left axis (sine of the angle {value:.3g})"
        _refuse_below(motion.t, sideways, LEAST_ANGLE, text)
        text = "the vertical part of a + g z + d v is {value:.3g} m/s^2: the vehicle falls or tips over"
        _refuse_below(motion.t, force[:, 2], least, text)


def _refuse_below(t: Array, values: Values, least: float, text: str) -> None:
    """UnsafeTrajectoryError at the sample with the least value if that is below `least`, or not a number."""
    if not len(t) or bool(np.all(values >= least)):
        return
    worst = int(np.argmin(np.where(np.isnan(values), -np.inf, values)))
    raise UnsafeTrajectoryError(
        f"at {t[worst]:.3g} s {text.format(value=values[worst])}, at least {least:.3g} is needed",
        where=f"time {t[worst]:.3g} s",
        next_step="Choose a slower or smaller flight.",
    )
