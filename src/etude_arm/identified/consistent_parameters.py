"""Physically consistent parameters from samples, with their error on segments left out of the fit.

The log likelihood of the inertial parameters is a quadratic form for each segment. Each drive also has own
terms (armature, friction, offset), which are marginalised with the prior of `physics.rigid_body`.

Simulation models merge links of one rigid part. Here each link keeps its own parameters; combinations that
logs cannot identify stay as near to the file as possible.

    minimise over phi   1/2 phi' H phi - g' phi + weight * sum_b D(P_b | P_b0)
    D(P | P0) = tr(P0^-1 P) - log det(P0^-1 P) - 4

H and g come from the logs, P_b is the pseudo-inertia of body b (`pseudo_inertia`), P_b0 that of the file. The
second term is the divergence of Lee, Wensing and Park 2020. It does not depend on units or frames, and is
infinite at the limit of physical consistency, so an unconstrained convex problem gives a possible robot. The
solver is Newton's method with exact derivatives, in coordinates in which every P_b0 is the unit matrix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.errors import NumericalError
from etude.types import Array, Index, Mask, Samples
from etude_arm.identified.combinations import MEASURED, combinations, share_of
from etude_arm.identified.model_file_writer import APART, FUSED, Dip, JointTerms
from etude_arm.identified.parameter_fit import (
    FRICTION,
    LOST,
    SHOWN,
    STRIBECK,
    WAVES,
    Settled,
    parameter_fit,
    settled,
)
from etude_arm.identified.pseudo_inertia import SIZE, basis, coordinates
from etude_arm.loading.inertia import NO_MASS
from etude_arm.loading.load import load_arm
from etude_arm.physics.kinematics import KinematicTree
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.physics.rigid_body import SPEED, command_regressors
from etude_arm.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco
from etude_arm.physics.transmission import Drive
from etude_arm.spec import FIRST_WAVE, PATH, PLAN, ArmSpec

MOST_FOLDS = 10  # number of cross-validation folds over segments
DROPPED = 1e-9  # prior deviation, command units


@dataclass(frozen=True, eq=False)
class Errors:
    """Root mean square errors on segments left out, (J,) each, command units.

    Attributes:
        file: with the model file's inertias. identified: with the identified ones. The other segments give
            friction, armature and offset of each drive in both.
        segments: their number; 0: a single one, so cross-validation is impossible.
    """

    file: Array
    identified: Array
    segments: int


@dataclass(frozen=True, eq=False)
class Normal:
    """Information matrix A (J, n, n) and vector b (J, n) of each command on [phi, own terms], n = P + E."""

    A: Array
    b: Array

    def __add__(self, other: Normal) -> Normal:
        return Normal(self.A + other.A, self.b + other.b)


@dataclass(frozen=True, eq=False)
class Links:
    """Attributes:
    names: of the B - 1 bodies beside the world, as in the file.
    tree, drives: the robot's geometry with them.
    nominal: (P,) the file's parameters; zero where a body has no mass or does not move.
    """

    names: tuple[str, ...]
    tree: KinematicTree
    drives: tuple[Drive, ...]
    nominal: Array

    @property
    def identifiable(self) -> tuple[tuple[str, slice], ...]:
        """Names and places in phi of the bodies with identifiable parameters."""
        places = [slice(10 * b, 10 * b + 10) for b in range(len(self.names))]
        pairs = zip(self.names, places, strict=True)
        return tuple((name, place) for name, place in pairs if self.nominal[place.start] > 0.0)


def links_of(spec: ArmSpec) -> Links:
    """The links of the robot's model file. Errors as `load_arm`."""
    loaded = load_arm(spec, shapes=False, drives=True)
    model = replace(loaded, xml=loaded.xml.replace(FUSED, APART)).model()
    tree = tree_from_mujoco(model, spec.names)
    bodies = [str(model.body(b).name) for b in range(1, model.nbody)]
    names = tuple(loaded.links.get(body, body) for body in bodies)
    nominal = tree.nominal[1:].copy()
    still = [not tree.path(b) or tree.nominal[b, 0] <= NO_MASS for b in range(1, model.nbody)]
    nominal[np.array(still)] = 0.0
    return Links(names, tree, drives_from_mujoco(model, spec.names), nominal.reshape(-1))


@dataclass(frozen=True, eq=False)
class WhitenedRows:
    """Samples as rows of regressors, divided by the noise deviation.

    Attributes:
        rows: for each command its regressors (n, P + E) and values (n,), both divided by the noise deviation.
        group: of each command (n,), which segment a row is of.
        weights: (J,) of one sample, since residuals of neighbours are correlated.
        drive_prior: (J, E) prior deviations of each drive's own terms, as of `parameter_fit`.
        deviation: (J,) the noise's, command units.
    """

    rows: Sequence[tuple[Array, Array]]
    group: Sequence[Index]
    weights: tuple[float, ...]
    drive_prior: Array
    deviation: Array

    @staticmethod
    def of(links: Links, base_fit: Settled) -> WhitenedRows:
        """The data from samples, with the drives' terms, noise and correlation time of the base parameters'
        fit.
        """
        problem, fit, samples = base_fit.problem, base_fit.fit, base_fit.problem.samples
        model, first = problem.mean.model, len(fit.z)
        motion = tuple(samples.log[name] for name in (PLAN if problem.mean.desired else PATH))
        rigid, _ = command_regressors(links.tree, links.drives, model.friction_velocity, *motion)
        rows, groups = [], []
        for j, output in enumerate(base_fit.outputs):
            used, noise = problem.used[:, j], float(fit.noise[j])
            both = np.concatenate([rigid[used, j], output.columns[:, first:]], axis=1)
            rows.append((both / noise, base_fit.command[used, j] / noise))
            groups.append(samples.group[used])
        # a term that was dropped stays at zero
        deviations = np.array([np.maximum(output.deviations, DROPPED) for output in base_fit.outputs])
        return WhitenedRows(rows, groups, tuple(fit.weight.tolist()), deviations, fit.noise)

    def normal(self, groups: Sequence[int] | None = None) -> Normal:
        """The information of those groups; None: of all."""
        pairs = []
        for (rows, y), group, weight in zip(self.rows, self.group, self.weights, strict=True):
            used = slice(None) if groups is None else np.isin(group, groups)
            pairs.append((weight * rows[used].T @ rows[used], weight * rows[used].T @ y[used]))
        A, b = zip(*pairs, strict=True)
        return Normal(np.array(A), np.array(b))

    def reduced(self, normal: Normal) -> tuple[Array, Array]:
        """H (P, P) and g (P,) of phi alone, with the drives' own terms eliminated."""
        P = normal.A.shape[1] - self.drive_prior.shape[1]
        H, g = np.zeros((P, P)), np.zeros(P)
        for A, b, prior in zip(normal.A, normal.b, self.drive_prior, strict=True):
            gain = np.linalg.solve(A[P:, P:] + np.diag(prior**-2), A[P:, :P]).T
            H += A[:P, :P] - gain @ A[P:, :P]
            g += b[:P] - gain @ b[P:]
        return 0.5 * (H + H.T), g

    def drive_terms(self, normal: Normal, phi: Array) -> Array:
        """(J, E) the drives' best own terms given phi."""
        P = len(phi)
        return np.array(
            [
                np.linalg.solve(A[P:, P:] + np.diag(prior**-2), b[P:] - A[P:, :P] @ phi)
                for A, b, prior in zip(normal.A, normal.b, self.drive_prior, strict=True)
            ]
        )

    def fitted(self, normal: Normal, nominal: Array) -> tuple[WhitenedRows, Consistent, Array]:
        """The minimum near the file's parameters (P,) and the drives' terms (J, E), with no rotor inertia
        below zero; such a one is held at zero in the rows that come back.

        A file of large inertias would else keep them, less a rotor's, where only the sum moves.
        """
        rows = self
        while True:
            result = consistent(*rows.reduced(normal), nominal)
            terms = rows.drive_terms(normal, result.phi)
            below = (terms[:, ARMATURE] < 0.0) & (rows.drive_prior[:, ARMATURE] > DROPPED)
            if not below.any():
                return rows, result, terms
            held = rows.drive_prior.copy()
            held[below, ARMATURE] = DROPPED
            rows = replace(rows, drive_prior=held)

    def squared_error(self, phi: Array, terms: Array, groups: Sequence[int]) -> Array:
        """(J,) mean squared error on those groups, command units squared."""
        errors = []
        for j, ((rows, y), group) in enumerate(zip(self.rows, self.group, strict=True)):
            used = np.isin(group, groups)
            residual = y[used] - rows[used] @ np.concatenate([phi, terms[j]])
            errors.append(float(np.mean(residual**2)) if used.any() else np.nan)
        return np.asarray(np.array(errors) * self.deviation**2)


ARMATURE = 0  # of a drive's own terms
WEIGHT = 1.0
"""Weight of D. At the file's values D is half the squared length of the coordinates, so each coordinate has a
prior deviation of 1: a mass deviates by itself, for example.
"""
CONTINUATION = tuple(10.0**k for k in range(8, -1, -1))
"""Factors of the weight; each minimisation starts from the last minimum."""
MOST_STEPS = 100  # a bound: the problem is convex
TOLERANCE = 1e-10  # part of the objective: rounding of its sums
E = basis()


@dataclass(frozen=True, eq=False)
class Consistent:
    """The minimum.

    Attributes:
        phi: (P,) parameters, body after body; those of bodies without mass in the file stay zero.
        covariance: (P, P) of phi given the logs, prior: (P, P) before them.
    """

    phi: Array
    covariance: Array
    prior: Array


def consistent(H: Array, g: Array, nominal: Array, weight: float = WEIGHT) -> Consistent:
    """Minimises the objective of the module.

    Args:
        H: (P, P) and g: (P,) of the logs, in units of phi.
        nominal: (P,) the file's parameters, ten for each body.
        weight: of the divergence from them.

    Raises:
        NumericalError: no minimum was reached.
    """
    T, start = _whole(nominal)
    Q, b = T.T @ H @ T, T.T @ g
    x = start
    # continuation from the file's values to those of the logs: a direct start takes many Newton steps
    for stiffer in CONTINUATION:
        x = _newton(Q, b, x, stiffer * weight)
    curvature = Q + weight * _barrier(x)[2]
    covariance = T @ np.linalg.inv(curvature) @ T.T
    prior = T @ np.linalg.inv(weight * _barrier(start)[2]) @ T.T
    return Consistent(T @ x, covariance, prior)


def _whole(nominal: Array) -> tuple[Array, Array]:
    """T (P, 10 b) of the b bodies that have a mass, and the coordinates (10 b,) of the file's values."""
    heavy = [k for k in range(0, len(nominal), SIZE) if nominal[k] > 0.0]
    T = np.zeros((len(nominal), SIZE * len(heavy)))
    for i, k in enumerate(heavy):
        T[k : k + SIZE, SIZE * i : SIZE * (i + 1)] = coordinates(nominal[k : k + SIZE])
    return T, np.tile(np.einsum("kii->k", E), len(heavy))


def _newton(Q: Array, b: Array, x: Array, weight: float) -> Array:
    for _ in range(MOST_STEPS):
        value, slope, bend = _barrier(x)
        slope = Q @ x - b + weight * slope
        step = np.asarray(np.linalg.solve(Q + weight * bend, -slope), dtype=np.float64)
        decrease = -float(slope @ step)  # Newton decrement: twice the gain of a full step
        if decrease < TOLERANCE * (1.0 + abs(float(b @ x))):
            return np.asarray(x + step) if np.isfinite(_barrier(x + step)[0]) else x
        x = x + _length(Q, b, x, step, weight, value, decrease) * step
    raise NumericalError(
        "no physically possible inertias explain the commands",
        next_step="Use etude inspect to check whether the commands are forces at the joints, with the "
        "right signs.",
    )


def _length(Q: Array, b: Array, x: Array, step: Array, weight: float, value: float, decrease: float) -> float:
    """The largest step of 1, 1/2, ... that stays feasible and gains a tenth of the linear prediction."""
    before = 0.5 * float(x @ Q @ x) - float(b @ x) + weight * value
    length = 1.0
    # shorter steps change no digit of x
    while length > 1e-12:
        new = x + length * step
        after = 0.5 * float(new @ Q @ new) - float(b @ new) + weight * _barrier(new, only_value=True)[0]
        # Armijo's rule
        if after <= before - 0.1 * length * decrease:
            return length
        length *= 0.5
    return 0.0


def _barrier(x: Array, only_value: bool = False) -> tuple[float, Array, Array]:
    """sum_b tr(X) - log det X - 4, its gradient and Hessian in the coordinates; infinite if infeasible."""
    slope, bend = np.zeros(len(x)), np.zeros((len(x), len(x)))
    value = 0.0
    for k in range(0, len(x), SIZE):
        block = slice(k, k + SIZE)
        X = np.einsum("k,kij->ij", x[block], E)
        if np.linalg.eigvalsh(X)[0] <= 0.0:
            return np.inf, slope, bend
        value += float(np.trace(X)) - float(np.linalg.slogdet(X)[1]) - len(X)
        if only_value:
            continue
        inverse = np.linalg.inv(X)
        slope[block] = np.einsum("kii->k", E) - np.einsum("ij,kji->k", inverse, E)
        turned = np.einsum("ij,kjl,lm->kim", inverse, E, inverse)
        bend[block, block] = np.einsum("kij,lji->kl", turned, E)
    return value, slope, bend


@dataclass(frozen=True, eq=False)
class Identified:
    """The result of `identified`.

    Attributes:
        links: the bodies of the file. result: their parameters. drive_terms: (J, E) terms of the drives.
        joints: armature, friction and cogging of each joint with a drive of its own.
        ripple: (J,) rms of the periodic term of each hinge's position (cogging), command units. errors: of
            cross-validation. used: (n, J) samples in which a joint moves away from reversals.
        lost: (J, 2) dead band, command units, and backlash, rad; zero where the logs show none.
        shown, measured: numbers of base parameters, and of those that the logs identify.
    """

    links: Links
    result: Consistent
    drive_terms: Array
    used: Mask
    joints: Mapping[str, JointTerms]
    ripple: Array
    errors: Errors
    lost: Array
    shown: int
    measured: int


def _joint_terms(
    spec: ArmSpec, links: Links, evidence: WhitenedRows, drive_terms: Array, base_fit: Settled
) -> Mapping[str, JointTerms]:
    """Terms of drives of a single joint; none is negative. Friction c sign(v) + d v is the best fit to the
    identified friction over the speeds of the logs.
    """
    terms, first = {}, len(links.nominal)
    for j, (name, drive) in enumerate(zip(spec.names, links.drives, strict=True)):
        if not drive.side(j):
            continue
        turn = abs(drive.gear * float(drive.coefficients[j]))
        columns = evidence.rows[j][0][:, first:] * evidence.deviation[j]
        friction, damping = _nearest(columns, drive_terms[j])
        dip = None
        if base_fit.evidence[j, STRIBECK] > SHOWN and drive_terms[j, STRIBECK] > 0.0:
            slid, rubbed = _nearest(
                columns, np.where(np.arange(drive_terms.shape[1]) == STRIBECK, 0.0, drive_terms[j])
            )
            slow = float(base_fit.speeds[0, j]) / turn
            dip = Dip(rubbed * turn**2, slid * turn, float(drive_terms[j, STRIBECK]) * turn, slow)
        armature = max(0.0, float(drive_terms[j, ARMATURE])) * turn**2
        waves = _driving(drive.side(j) * turn * drive_terms[j, WAVES]) if base_fit.cogs[j] else ()
        fastest = float(np.abs(columns[:, SPEED]).max()) / turn
        terms[name] = JointTerms(armature, damping * turn**2, friction * turn, waves, dip, fastest)
    return terms


def _nearest(columns: Array, terms: Array) -> tuple[float, float]:
    """c and d of the drive's friction, given its terms (E,) and their columns (n, E)."""
    from scipy.optimize import nnls

    speed, force = columns[:, SPEED], columns[:, FRICTION] @ terms[FRICTION]
    friction, damping = nnls(np.column_stack([np.sign(speed), speed]), force)[0].tolist()
    return friction, damping


def _driving(taken: Array) -> tuple[tuple[int, float, float], ...]:
    """Periods, amplitude and phase of the force on a joint whose command contains these `waves` (2 R,)."""
    return tuple(
        (FIRST_WAVE + k, float(np.hypot(sine, cosine)), float(np.arctan2(-cosine, -sine)))
        for k, (sine, cosine) in enumerate(taken.reshape(-1, 2))
    )


def identified(samples: Samples, spec: ArmSpec, mean: RigidBodyMean) -> Identified:
    """Identifies physically consistent parameters from samples, near those of the file.

    Args:
        samples: of all logs. mean: the identified model of the same samples, for the noise.

    Raises:
        NumericalError: no possible inertias explain the commands.
    """
    links = links_of(spec)
    base_fit = settled(samples, spec, mean)
    evidence = WhitenedRows.of(links, base_fit)
    evidence, result, drive_terms = evidence.fitted(evidence.normal(), links.nominal)
    joints = _joint_terms(spec, links, evidence, drive_terms, base_fit)
    first = len(links.nominal)
    pairs = zip(evidence.rows, drive_terms, strict=True)
    waves = [rows[:, first:][:, WAVES] @ terms[WAVES] for (rows, _), terms in pairs]
    ripple = np.array([np.sqrt(np.mean(one**2)) for one in waves])
    ripple *= evidence.deviation
    fit = parameter_fit(base_fit)
    bases, _ = combinations(fit)
    measured = sum(share_of(fit, one) >= MEASURED for one in bases)
    errors = _cross_validated(evidence, links, samples)
    used = base_fit.problem.used
    lost = np.where(fit.friction.evidence[:, LOST] > SHOWN, fit.friction.terms[:, LOST], 0.0)
    return Identified(links, result, drive_terms, used, joints, ripple, errors, lost, len(bases), measured)


def _cross_validated(evidence: WhitenedRows, links: Links, samples: Samples) -> Errors:
    groups = np.unique(samples.group)
    folds = np.array_split(groups, min(len(groups), MOST_FOLDS))
    if len(folds) < 2:
        unknown = np.full(len(evidence.deviation), np.nan)
        return Errors(unknown, unknown, 0)
    squares = []
    for fold in folds:
        others = evidence.normal([int(g) for g in groups if g not in fold])
        result = consistent(*evidence.reduced(others), links.nominal)
        squares.append(
            [
                evidence.squared_error(phi, evidence.drive_terms(others, phi), fold.tolist())
                for phi in (links.nominal, result.phi)
            ]
        )
    file, fit = np.sqrt(np.nanmean(squares, axis=0))
    return Errors(file, fit, len(groups))
