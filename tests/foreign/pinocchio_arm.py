"""An arm that Étude did not make: rigid bodies by pinocchio, drives that are not ideal, its own controller.

M(q) qdd + h(q, qd) = command - friction(qd) - cogging(q), at 1 kHz, semi-implicit. Exported bytes go in; a
log in a user's form and the tracking error come out. Nothing of Étude is imported. Featherstone, Rigid Body
Dynamics Algorithms, 2008 (pinocchio); Armstrong-Helouvry et al., Automatica 30 (1994): Stribeck's dip.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

pin = pytest.importorskip(
    "pinocchio", reason="pinocchio has no wheel for this Python or system: pip install pin"
)

Array = NDArray[np.float64]
RATE = 1000.0
Law = Literal["pd", "pd_gravity", "computed_torque"]
SHARE_COULOMB, SHARE_STICTION, SHARE_VISCOUS, SHARE_COGGING = 0.03, 0.012, 0.02, 0.01
"""Of the torque limit: Coulomb friction, what stiction adds, viscous friction at top speed, cogging."""
SMOOTH = 0.002
"""Part of the top speed over which friction turns its sign: presliding of real gears, and a finite slope."""
STRIBECK = 0.03
"""Part of the top speed at which the added stiction has fallen to 1/e."""


@dataclass(frozen=True)
class Drives:
    """What a motor and its gear add to rigid bodies, each (J,) in N m (N), rad (m), s.

    Attributes:
        coulomb, stiction: of friction; stiction is what it has more at rest.
        viscous: N m s/rad.
        smooth, stribeck: rad/s, where friction turns, and where stiction has fallen to 1/e.
        cogging: amplitude. poles: periods per turn. phase: rad.
        armature: kg m^2, the rotor's inertia through the gear.
        delay: s from a command to its torque, whole steps.
        encoder: rad, one count. torque_step, torque_noise: of what is logged.
    """

    coulomb: Array
    stiction: Array
    viscous: Array
    smooth: Array
    stribeck: Array
    cogging: Array
    poles: Array
    phase: Array
    armature: Array
    delay: float = 0.002
    encoder: float = 2.0 * np.pi / 2**17
    torque_step: Array = field(default_factory=lambda: np.zeros(1))
    torque_noise: Array = field(default_factory=lambda: np.zeros(1))

    def friction(self, qd: Array) -> Array:
        """(..., J) at these speeds."""
        return np.asarray(self._dry(qd) * np.tanh(qd / self.smooth) + self.viscous * qd)

    def ripple(self, q: Array) -> Array:
        """(..., J) cogging at these angles."""
        return np.asarray(self.cogging * np.sin(self.poles * q + self.phase))

    def secant(self, qd: Array) -> Array:
        """(J,) friction over speed, finite at rest."""
        v = np.where(np.abs(qd) < 1e-9, 1e-9, qd)
        return np.asarray(self._dry(v) * np.tanh(v / self.smooth) / v + self.viscous)

    def _dry(self, qd: Array) -> Array:
        return np.asarray(self.coulomb + self.stiction * np.exp(-((qd / self.stribeck) ** 2)))


@dataclass(frozen=True, eq=False)
class Arm:
    """The plant, and what its maker's controller believes.

    Attributes:
        true: pinocchio's model with the true masses and armatures.
        believed: that of the description's file.
        names: of the joints. lower, upper, speed, torque: (J,) limits of the file.
        drives: see `Drives`.
    """

    true: Any
    believed: Any
    names: tuple[str, ...]
    lower: Array
    upper: Array
    speed: Array
    torque: Array
    drives: Drives

    @property
    def gains(self) -> tuple[Array, Array]:
        """kp, kd (J,): 5 Hz, damping .8, on each joint's own inertia in the middle of its range."""
        data = self.believed.createData()
        inertia = (
            np.diag(pin.crba(self.believed, data, 0.5 * (self.lower + self.upper))) + self.drives.armature
        )
        w = 2.0 * np.pi * 5.0
        return inertia * w**2, 2.0 * 0.8 * w * inertia


def arm_of_urdf(
    text: str,
    joints: tuple[str, ...] = (),
    *,
    wrong: float = 1.15,
    seed: int = 0,
    speed: float = np.inf,
    torque: Mapping[str, float] | None = None,
) -> Arm:
    """The arm of a URDF's text.

    Args:
        joints: that move; the others are locked at zero. (): all.
        wrong: each true mass is the file's times or by at most this factor; its centre is off by as many
            per cent of 0.1 m.
        seed: of what is drawn: masses, drives.
        speed: rad/s, that no joint exceeds whatever the file says.
        torque: N m, limits of joints whose file gives none.
    """
    whole = pin.buildModelFromXML(one_turn(text))
    keep = joints or tuple(whole.names)[1:]
    locked = [whole.getJointId(name) for name in whole.names[1:] if name not in keep]
    believed = pin.buildReducedModel(whole, locked, pin.neutral(whole)) if locked else whole
    names = tuple(believed.names)[1:]
    rng = np.random.default_rng(seed)
    limit = np.array([(torque or {}).get(name, believed.effortLimit[i]) for i, name in enumerate(names)])
    lower, upper = believed.lowerPositionLimit, believed.upperPositionLimit
    top = np.minimum(believed.velocityLimit, speed)
    true = believed.copy()
    for i in range(1, true.njoints):
        body = true.inertias[i]
        factor = np.exp(np.log(wrong) * rng.uniform(-1.0, 1.0))
        shift = 0.1 * (wrong - 1.0) * rng.uniform(-1.0, 1.0, 3)
        true.inertias[i] = pin.Inertia(body.mass * factor, body.lever + shift, body.inertia * factor)
    drives = drives_of(rng, limit, top)
    true.armature = drives.armature
    return Arm(true, believed, names, lower, upper, top, limit, drives)


def one_turn(text: str) -> str:
    """The text with joints of more than a turn cut to half a turn each way."""
    tree = ElementTree.fromstring(text)
    for joint in tree.iter("joint"):
        if joint.get("type") in ("continuous", "revolute"):
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
            free = joint.get("type") == "continuous"
            ends = [-np.inf, np.inf] if free else [float(limit.get(word, "0")) for word in ("lower", "upper")]
            joint.set("type", "revolute")
            if ends[1] - ends[0] > 2.0 * np.pi:
                ends = [max(ends[0], -np.pi), min(ends[1], np.pi)]
            limit.set("lower", repr(float(ends[0])))
            limit.set("upper", repr(float(ends[1])))
    return ElementTree.tostring(tree, encoding="unicode")


def drives_of(rng: np.random.Generator, torque: Array, speed: Array) -> Drives:
    """Drives in proportion to torque limits, each share times or by at most 1.5."""
    n = len(torque)

    def drawn(share: float) -> Array:
        return np.asarray(share * torque * 1.5 ** rng.uniform(-1.0, 1.0, n))

    return Drives(
        drawn(SHARE_COULOMB),
        drawn(SHARE_STICTION),
        drawn(SHARE_VISCOUS) / speed,
        SMOOTH * speed,
        STRIBECK * speed,
        drawn(SHARE_COGGING),
        rng.integers(2, 7, n).astype(float),
        rng.uniform(0.0, 2.0 * np.pi, n),
        0.002 * torque,
        torque_step=torque / 2**11,
        torque_noise=0.003 * torque,
    )


@dataclass(frozen=True)
class Reference:
    """Set-points at 1 kHz: t (T,) s; q, qd, qdd (T, J); effort (T, J), added to the controller's, or None."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    effort: Array | None = None

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(T,) while any joint moves."""
        return np.asarray(np.abs(self.qd).max(axis=1) > 1e-6)


def held(reference: Reference, before: float = 10.0, after: float = 10.0) -> Reference:
    """The same with the first and the last row's position repeated, as a player does that keeps sending."""
    counts = round(before * RATE), round(after * RATE)
    t = reference.t[0] + (np.arange(sum(counts) + len(reference.t)) - counts[0]) / RATE

    def longer(table: Array, zero: bool) -> Array:
        ends = [
            np.repeat(table[[i]] * (0.0 if zero else 1.0), n, axis=0)
            for i, n in zip((0, -1), counts, strict=True)
        ]
        return np.concatenate([ends[0], table, ends[1]])

    effort = None if reference.effort is None else longer(reference.effort, False)
    return Reference(
        t, longer(reference.q, False), longer(reference.qd, True), longer(reference.qdd, True), effort
    )


def reference_of_table(data: bytes, names: tuple[str, ...]) -> Reference:
    """A user's reader of trajectory.csv, `q_NAME`, `qd_NAME`, `qdd_NAME`: cubics between its rows."""
    header, *rows = csv.reader(io.StringIO(data.decode()))
    table = np.array([[float(cell) for cell in row] for row in rows])
    place = {name: i for i, name in enumerate(header)}
    q, qd, qdd = (table[:, [place[prefix + name] for name in names]] for prefix in ("q_", "qd_", "qdd_"))
    knots = table[:, place["time"]]
    t = np.arange(round(knots[-1] * RATE) + 1) / RATE
    k = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
    h = (knots[k + 1] - knots[k])[:, None]
    u = (t - knots[k])[:, None] / h
    a, b = q[k], q[k + 1]
    va, vb = qd[k] * h, qd[k + 1] * h
    path = a + u * va + u**2 * (3 * (b - a) - 2 * va - vb) + u**3 * (2 * (a - b) + va + vb)
    rate = (va + 2 * u * (3 * (b - a) - 2 * va - vb) + 3 * u**2 * (2 * (a - b) + va + vb)) / h
    return Reference(t, path, rate, (1.0 - u) * qdd[k] + u * qdd[k + 1])


@dataclass(frozen=True)
class Run:
    """What happened, at 1 kHz.

    Attributes:
        reference: what was wanted. q, qd: (T, J) true. command: (T, J) as it was given, within the limits.
        q_read, qd_read, tau_read: (T, J) what the robot logs.
    """

    arm: Arm
    reference: Reference
    q: Array
    qd: Array
    command: Array
    q_read: Array
    qd_read: Array
    tau_read: Array

    @property
    def tracking(self) -> Array:
        """(J,) rad, rms of the position error while any joint moves."""
        moving = self.reference.moving
        return np.asarray(np.sqrt(np.mean((self.reference.q - self.q)[moving] ** 2, axis=0)))

    @property
    def saturated(self) -> float:
        """Share of samples with a torque at its limit."""
        return float(np.mean(np.abs(self.command) >= self.arm.torque * (1.0 - 1e-9)))

    def left(self) -> dict[str, float]:
        """Largest excess over a limit, as a part of it; negative while all of a limit is kept."""
        span = self.arm.upper - self.arm.lower
        over = np.maximum(self.q - self.arm.upper, self.arm.lower - self.q) / span
        return {
            "position": float(over.max()),
            "velocity": float((np.abs(self.qd) / self.arm.speed).max() - 1.0),
        }

    def log(self, rate: float = 250.0) -> bytes:
        """CSV as a user's logger writes it: time_s, q1_rad.., dq1_rad_s.., tau1_Nm.., in their order."""
        step = round(RATE / rate)
        n = len(self.arm.names)
        header = ["time_s"]
        header += [
            f"{word}{j + 1}_{unit}"
            for word, unit in (("q", "rad"), ("dq", "rad_s"), ("tau", "Nm"))
            for j in range(n)
        ]
        t = self.reference.t - self.reference.t[0]
        table = np.column_stack([t, self.q_read, self.qd_read, self.tau_read])[::step]
        lines = "\n".join(",".join(f"{x:.7g}" for x in row) for row in table.tolist())
        return (",".join(header) + "\n" + lines + "\n").encode()


def run(arm: Arm, reference: Reference, law: Law = "pd_gravity", *, seed: int = 0) -> Run:
    """The arm follows the reference from rest at its first row.

    Args:
        law: of the controller: PD; with the believed gravity at the measured pose; or with the believed
            inverse dynamics along the reference. The reference's effort is added, and replaces gravity.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    count, n = reference.q.shape
    drives, dt = arm.drives, 1.0 / RATE
    kp, kd = arm.gains
    true, believed = arm.true, arm.believed
    data, own = true.createData(), believed.createData()
    extra = np.zeros((count, n)) if reference.effort is None else reference.effort
    if law == "computed_torque":
        rows = zip(reference.q, reference.qd, reference.qdd, strict=True)
        extra = extra + np.stack([pin.rnea(believed, own, *row) for row in rows])
    late = round(drives.delay * RATE)
    q, qd = reference.q[0].copy(), np.zeros(n)
    first = pin.rnea(true, data, q, qd, qd) if law != "pd" or reference.effort is not None else np.zeros(n)
    waiting = [first] * late
    seen = np.round(q / drives.encoder) * drives.encoder
    speed, share = np.zeros(n), 1.0 - np.exp(-2.0 * np.pi * 60.0 * dt)  # first-order filter of the difference
    kept = np.empty((5, count, n))
    want_q, want_qd = reference.q, reference.qd
    above, diagonal = np.triu(np.ones((n, n), dtype=bool)), np.arange(n)
    for i in range(count):
        read = np.round(q / drives.encoder) * drives.encoder
        speed = speed + share * ((read - seen) / dt - speed)
        seen = read
        command = kp * (want_q[i] - read) + kd * (want_qd[i] - speed) + extra[i]
        if law == "pd_gravity" and reference.effort is None:
            command = command + pin.computeGeneralizedGravity(believed, own, read)
        command = np.minimum(np.maximum(command, -arm.torque), arm.torque)
        kept[:, i] = q, qd, command, read, speed
        waiting.append(command)
        push = waiting.pop(0) - drives.ripple(q)
        mass = pin.crba(true, data, q)
        mass = np.where(above, mass, mass.T)  # the other half is not computed
        bias = pin.nonLinearEffects(true, data, q, qd)
        # friction by its secant, implicit: it never turns a joint's direction within a step
        with_friction = mass.copy()
        with_friction[diagonal, diagonal] += dt * drives.secant(qd)
        qd = np.linalg.solve(with_friction, mass @ qd + dt * (push - bias))
        q = q + dt * qd
    out = dict(zip(("q", "qd", "command", "q_read", "qd_read"), kept, strict=True))
    noise = drives.torque_noise * rng.standard_normal((count, n))
    step = np.where(drives.torque_step > 0.0, drives.torque_step, 1.0)
    tau = np.where(
        drives.torque_step > 0.0, np.round((out["command"] + noise) / step) * step, out["command"] + noise
    )
    return Run(arm, reference, **out, tau_read=tau)
