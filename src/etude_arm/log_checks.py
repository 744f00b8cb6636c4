"""Log checks of an arm: another rate than the robot's, brakes, and another mounting of the base than in the
model file.

A model file's command at a pose is linear in gravity: command = inertial part + G(q) g + friction. So least
squares give g for comparison with the file's, whose size is free: masses may be wrong, but not the direction.
A wrong centre of mass has the same effect in one joint, but not in two.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.logs.checks.filtered_motion import MOVING, Seen, seen, states_of
from etude.logs.checks.finding_texts import OfRecorder, accepted
from etude.logs.checks.plausibility import brake_finding
from etude.logs.cleaning.filters import median_rate
from etude.types import Array, Finding, Log
from etude_arm.loading.rotations import turn_of
from etude_arm.spec import COMMAND, PATH, ArmSpec

ROBOT_RATE = "robot rate"
ALIKE = 1.4
"""Of rates: below, it is a clock's inaccuracy or a bus's."""


def findings(spec: ArmSpec, log: Log) -> Sequence[Finding]:
    """The findings of every check."""
    limit = np.array([axis.command for axis in spec.axes])
    return (_rate(spec, log), brake_finding(log, log.channels[COMMAND], limit), *_mounting(spec, log))


MOUNTING = "mounting"
APART_S = 0.5  # s between independent samples
LEAST_ROWS = 20  # of motion, of which gravity is found
TURNED = 20.0  # degrees off the file's gravity: no zero of a joint that is a little off
EARTH = 9.81  # m/s^2
OFF = 1.4  # factor by which the size may be off: beyond, masses or units are wrong
LEFT = 0.1  # of what friction does not explain of the commands: gravity has to explain the rest
JOINTS, CLEARER = 2, 3.0  # that this holds of, each, and how much more the file's direction leaves there
MARGIN = 30.0  # log likelihood over the file's direction
ROUNDS = 10  # of weighing joints by what is left of them
OPPOSITE = 150.0  # degrees: signs that are all inverted look alike


def mounting_finding(
    motion: Seen, inertial: Array, pulls: Array, gravity: Array, base: Array | None = None
) -> Finding | None:
    """Another direction of gravity, if the commands leave no doubt; else None.

    Args:
        motion: the recorded motion.
        inertial: (n, k) commands of the model file without gravity.
        pulls: (n, k, 3) commands of the model file for 1 m/s^2 along each axis of the world.
        gravity: (3,) m/s^2 in the file.
        base: (3, 3) described rotation of the base; None: none.
    """
    base = np.eye(3) if base is None else base
    joints = np.flatnonzero(motion.moves & (motion.moving.sum(axis=0) >= LEAST_ROWS)).tolist()
    if motion.command is None or not joints or not gravity.any():
        return None
    parts = [_without_friction(motion, j, motion.command[:, j] - inertial[:, j], pulls[:, j]) for j in joints]
    estimate, weights = _fitted(parts)
    size = float(np.linalg.norm(estimate))
    if not EARTH / OFF < size < EARTH * OFF:
        return None
    best, file = (_mean_squares(parts, g) for g in (estimate, _scaled(parts, weights, gravity)))
    count = motion.seconds[joints] / APART_S
    margin = float(0.5 * (count * np.log(file / np.maximum(best, np.finfo(float).tiny))).sum())
    whole = _mean_squares(parts, np.zeros(3))
    clear = (best < LEFT * whole) & (file > CLEARER * best)
    if (
        angle_between(estimate, gravity) < TURNED
        or margin < MARGIN
        or best.sum() > LEFT * whole.sum()
        or clear.sum() < JOINTS
    ):
        return None
    return _as_finding(estimate, gravity, base)


def _without_friction(motion: Seen, j: int, command: Array, pull: Array) -> tuple[Array, Array]:
    """Command (m,) and pull (m, 3) of a joint's moving samples, less what a constant and friction explain."""
    rows = motion.moving[:, j]
    speed = motion.qd[rows, j]
    friction = [np.ones_like(speed), speed, np.tanh(speed / (MOVING * np.abs(speed).max()))]
    Q = np.linalg.qr(np.column_stack(friction))[0]
    y, G = command[rows], pull[rows]
    return y - Q @ (Q.T @ y), G - Q @ (Q.T @ G)


def _fitted(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Gravity (3,) that fits all joints by maximum likelihood, with the residual of each as weight (k,)."""
    tiny = np.finfo(float).tiny
    weights = np.array([1.0 / max(float((y * y).mean()), tiny) for y, _ in parts])
    for _ in range(ROUNDS):
        rows = np.concatenate(
            [np.sqrt(w) * np.column_stack([G, y]) for w, (y, G) in zip(weights, parts, strict=True)]
        )
        gravity = np.linalg.lstsq(rows[:, :3], rows[:, 3], rcond=None)[0]
        # a thousandth of a command at least: one joint that fits exactly would get all the weight
        least = [1e-6 * float((y * y).mean()) + tiny for y, _ in parts]
        weights = 1.0 / np.maximum(_mean_squares(parts, gravity), least)
    return gravity, weights


def _scaled(parts: list[tuple[Array, Array]], weights: Array, gravity: Array) -> Array:
    """The file's gravity with the best size, without a change of sign."""
    square = product = 0.0
    for w, (y, G) in zip(weights.tolist(), parts, strict=True):
        pull = G @ gravity
        square, product = square + w * float(pull @ pull), product + w * float(pull @ y)
    return max(0.0, product / max(square, np.finfo(float).tiny)) * gravity


def _mean_squares(parts: list[tuple[Array, Array]], gravity: Array) -> Array:
    """Residual mean square (k,) of each joint's command with this gravity."""
    return np.array([float(((y - G @ gravity) ** 2).mean()) for y, G in parts])


NEAR_QUARTER = 0.15  # rad: bases are mounted at quarter turns, and masses are known to so much


def _as_finding(estimate: Array, gravity: Array, base: Array) -> Finding:
    """The finding, with roll and pitch that turn gravity (3,) down in the base's present frame `base`."""
    fits, file = (", ".join(f"{x:.3g}" for x in np.round(g, 1) + 0.0) for g in (estimate, gravity))
    angle = angle_between(estimate, gravity)
    sign = " If it is not, the signs of all commands may be inverted." if angle > OPPOSITE else ""
    roll, pitch = (_quarter(x) for x in tilt_of(base.T @ estimate))
    return Finding(
        MOUNTING,
        "red",
        f"The commands fit gravity of ({fits}) m/s^2 in the model file's world, {angle:.0f} degrees off "
        f"its ({file}): the base is mounted differently from the robot file.",
        f"Write rotation = [{roll:.4g}, {pitch:.4g}, 0.0] into [mounting] of robot.toml (roll, pitch, yaw "
        "in rad; the yaw has no effect on gravity), or check the base, then ingest the log; "
        f"{accepted(MOUNTING)}.{sign}",
        flag=MOUNTING,
    )


def angle_between(a: Array, b: Array) -> float:
    """Angle, degrees."""
    cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def tilt_of(down: Array) -> tuple[float, float]:
    """Roll and pitch of a base in whose frame gravity points along `down` (3,)."""
    x, y, z = -down / np.linalg.norm(down)
    return float(np.arctan2(y, z)), float(np.arctan2(-x, np.hypot(y, z)))


def _quarter(angle: float) -> float:
    near = round(angle / (0.5 * np.pi)) * 0.5 * np.pi
    return float(near if abs(angle - near) < NEAR_QUARTER else angle) + 0.0


def _mounting(spec: ArmSpec, log: Log) -> tuple[Finding, ...]:
    """A finding by the model file, if there is one and commands are forces."""
    from etude_arm.loading.implausible import alike
    from etude_arm.physics.mean import physics_of

    if alike(spec):
        return ()  # placeholders do not show where down is
    nominal = physics_of(spec, 0.0, False).get("nominal")
    motion = seen(log, log.channels[PATH[0]])
    if nominal is None or motion is None:
        return ()
    body = nominal(None)
    states = states_of(motion.t, log.channels[PATH[0]], motion.q, motion.qd, motion.qdd)
    pulls = body.pulls(states)
    inertial = body.predict(states) - pulls @ body.gravity
    base = None if spec.mounting is None else turn_of(*spec.mounting.rotation)
    finding = mounting_finding(motion, inertial, pulls, body.gravity, base)
    return () if finding is None else (finding,)


def _rate(spec: ArmSpec, log: Log) -> OfRecorder:
    rate = median_rate(log.t)
    alike = 1.0 / ALIKE < rate / spec.rate < ALIKE
    link = "and" if alike else "but"
    sentence = f"The log has {rate:.4g} rows a second, {link} the robot file states {spec.rate:.4g}."
    if alike:
        return OfRecorder(ROBOT_RATE, "green", sentence)
    step = "If rows were thinned or the robot file is wrong, the log is right; else its clock is wrong."
    return OfRecorder(ROBOT_RATE, "yellow", sentence, step)
