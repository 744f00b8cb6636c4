"""Identification: maximum a posteriori least squares of each output, and the transition of its friction.

Where commands are forces, one rigid body makes them all:

    command_j = [M(q)^-T Y(q, qd, qdd)]_j (phi_0 + D z) + X_j e_j,    z ~ N(0, 1),  e_j ~ N(0, extra prior)

phi_0 are the model file's parameters, D the identifiable directions, X_j the drive's own terms. All commands
form one least squares problem in z and e_1 .. e_J, each weighted by its noise. So the torques of proximal
joints identify parameters that a joint's own torque hardly shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.types import Index, Mask, Samples
from etude_arm.inputs import FRICTION_SCALES
from etude_arm.physics.base_parameters import base_directions, parameter_scale, spread_states
from etude_arm.physics.kinematics import KinematicTree
from etude_arm.physics.regressor import nominal_parameters
from etude_arm.physics.rigid_body import (
    NARROW,
    SPEED,
    Regressors,
    RigidBody,
    RigidBodyModel,
    command_regressors,
    turned,
)
from etude_arm.physics.transmission import Drive
from etude_arm.spec import FORCES, FRICTION, PRESLIDING_DISTANCES

if TYPE_CHECKING:
    from etude_arm.spec import ArmSpec

Array = NDArray[np.float64]


def require_axes(samples: Samples, spec: ArmSpec, tree: KinematicTree, drives: tuple[Drive, ...]) -> None:
    """UsageError unless robot, model file and samples have the same axes."""
    axes = samples.command.shape[1]
    if tree.joints != spec.dof or len(drives) != spec.dof or axes != spec.dof:
        raise UsageError(
            "Robot, model file and samples must have the same axes",
            where=f"robot {spec.dof}, model file {tree.joints}, samples {axes}",
        )


def fitted(
    samples: Samples,
    regressors: Regressors,
    priors: Sequence[IdentificationPrior],
    names: Sequence[str],
    body: RigidBody,
    shared: Array | None = None,
    ripple: bool = False,
) -> RigidBodyModel:
    """Masked maximum a posteriori least squares of every output's parameters.

    An output has separate parameters if commands are not forces, or if this command has another scale.

    Args:
        samples: commands and masks.
        regressors: of the samples.
        priors: of the outputs, as `output_priors`. names: of their axes.
        body: geometry of the robot.
        shared: (P, r) directions of one rigid body for all outputs, as of `shared_directions`; None: none.
        ripple: whether the model keeps the periodic terms of hinge positions. Otherwise they only protect the
            masses.

    Raises:
        DataError: an axis never moved.
    """
    weight = Clock(samples.t, samples.group).information()
    by_speed = 1.0 / CLEARLY if FRICTION in samples.log else CLEARLY
    fits = []
    for j, (name, prior) in enumerate(zip(names, priors, strict=True)):
        moving = samples.moving[:, j] & samples.usable[:, j]
        if not np.any(moving):
            raise DataError(
                "An axis never moves, so nothing of it can be identified",
                where=name,
                next_step="Ingest a log that moves it, together with this one, or remove the axis.",
            )
        columns = _columns(regressors, moving, prior, body, j)
        fits.append(_fit_output(columns, samples.command[moving, j], prior, weight, by_speed))
    inertial, extras, deviation, rank, spreads, presliding = (
        np.array(part) for part in zip(*fits, strict=True)
    )
    model = RigidBodyModel(*body, inertial, extras, rank, deviation, spreads, presliding)
    return model if shared is None else _with_shared(model, samples, regressors, priors, shared, ripple)


def _with_shared(
    model: RigidBodyModel,
    samples: Samples,
    regressors: Regressors,
    priors: Sequence[IdentificationPrior],
    directions: Array,
    ripple: bool,
) -> RigidBodyModel:
    """The model with one rigid body for all outputs except those of another scale."""
    rigid, extra, turning, wave = regressors
    extra = extra if turning is None else model.turned(extra, turning)
    extra = extra if wave is None else np.concatenate([extra, wave], axis=2)
    E, outputs = model.extra.shape[1], []
    for j, prior in enumerate(priors):
        rows = samples.moving[:, j] & samples.usable[:, j]
        deviations = _near_level(prior.extra, model.extra[j], first=0)
        deviations[-1] = min(deviations[-1], OFFSET * prior.command)
        size = model.deviation[j] if ripple else WAVE * prior.command
        deviations = np.append(deviations, np.full(extra.shape[2] - E, size))
        residual = samples.command[rows, j] - rigid[rows, j] @ prior.nominal
        columns = np.concatenate([rigid[rows, j] @ directions, extra[rows, j]], axis=1)
        clock = Clock(samples.t[rows], samples.group[rows])
        outputs.append(OutputColumns(columns, residual, deviations, model.deviation[j], clock))
    limits = np.array([prior.command for prior in priors])
    fit, taken = _of_one_scale(outputs, directions.shape[1], limits, model.deviation, E if ripple else 0)
    values = {
        name: getattr(model, name).copy() for name in ("inertial", "extra", "extra_deviation", "deviation")
    }
    values["inertial"][taken] = priors[0].nominal + directions @ fit.z
    values["extra"][taken], values["extra_deviation"][taken] = fit.extra[:, :E], fit.spread[:, :E]
    values["deviation"][taken] = fit.noise
    waves = np.zeros((len(outputs), extra.shape[2] - E))
    waves[taken] = fit.extra[:, E:]
    return replace(model, **values, ripple=waves if ripple else None)


def _of_one_scale(
    outputs: Sequence[OutputColumns], r: int, limits: Array, alone: Array, friction: int
) -> tuple[SharedFit, list[int]]:
    """The fit of one rigid body to the outputs that it explains, and which these are.

    As long as the noise of one exceeds `OTHER_SCALE` times that of its own parameters, the output is left out
    without which the others agree best: the one with another scale spoils them all.

    Args:
        alone: (J,) noise with separate parameters. friction: columns before the ripple's; 0: no ripple.
    """

    def tried(taken: list[int]) -> tuple[float, SharedFit, list[int]]:
        chosen, within = [outputs[j] for j in taken], limits[taken]
        fit = shared_fit(chosen, r, within)
        fit = _rippled(fit, chosen, friction, r, within) if friction else fit
        return float(np.max(fit.noise / alone[taken])), fit, taken

    worst, fit, taken = tried(list(range(len(outputs))))
    while worst > OTHER_SCALE and len(taken) > 1:
        others = ([j for j in taken if j != out] for out in taken)
        worst, fit, taken = min(map(tried, others), key=lambda one: one[0])
    return fit, taken


def _rippled(fit: SharedFit, outputs: Sequence[OutputColumns], E: int, r: int, limits: Array) -> SharedFit:
    """The problem with the amplitude of each drive's ripple (the columns after the first E), found by
    expectation maximisation.
    """
    for _ in range(RIPPLE_ROUNDS):
        squares = fit.extra[:, E:] ** 2 + fit.spread[:, E:] ** 2
        sizes = np.sqrt(squares.mean(axis=1, keepdims=True)) * np.ones_like(squares)
        outputs = [
            replace(o, deviations=np.append(o.deviations[:E], size))
            for o, size in zip(outputs, sizes, strict=True)
        ]
        fit = shared_fit(outputs, r, limits)
    return fit


LEAST_CORRELATION = 0.5  # s; smoothed commands closer than this repeat each other


@dataclass(frozen=True, eq=False)
class Clock:
    """Times t (n,) of samples in s, and group (n,) of the recording that each belongs to.

    known: by lag, which samples follow another; residuals of many fits are correlated over the same lags.
    """

    t: Array
    group: Index
    known: dict[int, tuple[Mask | None, float]] = field(default_factory=dict, repr=False)

    def information(self, residual: Array | None = None) -> float:
        """Weight of one sample against the prior: samples within the correlation time count as one.

        Args:
            residual: (n,) residual of a command. None: not known yet.
        """
        time = (
            LEAST_CORRELATION if residual is None else max(self.correlation_time(residual), LEAST_CORRELATION)
        )
        # a residual correlated over more than 1000 samples is an offset, not less information
        return float(np.clip(self.step / time, 1e-3, 1.0))

    @cached_property
    def step(self) -> float:
        """Time between neighbouring samples, s."""
        steps = np.diff(self.t)[np.diff(self.group) == 0]
        return float(np.median(steps)) if len(steps) else LEAST_CORRELATION

    def correlation_time(self, residual: Array) -> float:
        """Integrated autocorrelation time of a residual (n,), in s.

        (1 + 2 rho_1 + 2 rho_2 + ..) steps, up to the first rho that is not positive (Geyer, Stat. Sci. 7,
        1992). Errors of the model, such as cogging, are correlated longer than noise.
        """
        power, total = float(np.mean(residual**2)), 1.0
        for lag in range(1, len(residual)):
            near, count = self._near(lag)
            products = residual[lag:] * residual[:-lag]
            product = float(np.add.reduce(products if near is None else products[near]))
            if product <= 0.0:
                break
            total += 2.0 * product / (count * power)
        return total * self.step

    def _near(self, lag: int) -> tuple[Mask | None, float]:
        """Mask (n - lag,) of samples that follow another after `lag` steps, None: all; and their number."""
        if lag not in self.known:
            near = np.abs(self.t[lag:] - self.t[:-lag]) <= (lag + 0.5) * self.step
            near &= self.group[lag:] == self.group[:-lag]
            self.known[lag] = None if near.all() else near, float(np.sum(near))
        return self.known[lag]


@dataclass(frozen=True)
class IdentificationPrior:
    """Prior of one output, from its physical scales.

    Attributes:
        nominal: (P,) the model file's parameters; directions: (P, r) base directions, z ~ N(0, 1) per unit
        of gain.
        gain: prior deviation of the command per N m; extra: (E,) of the extra terms.
        command: the command limit.
    """

    nominal: Array
    directions: Array
    gain: float
    extra: Array
    command: float

    @staticmethod
    def of_output(
        tree: KinematicTree, rigid: Array, extra: Array, command: float, force: bool
    ) -> IdentificationPrior:
        """Prior deviations such that no single term exceeds the command limit within the robot's limits.
        Viscous friction of a force is at most `VISCOUS` of that limit; that of a voltage may equal it
        (back-EMF).
        """
        nominal = nominal_parameters(tree)
        directions = base_directions(rigid, parameter_scale(tree))
        # the last link of a file may have no mass: then its prior mass gives the scale of torques
        torque = max(_root(rigid @ nominal), NO_TORQUE * _root(rigid @ directions))
        terms = command / np.sqrt(np.mean(extra**2, axis=0))
        terms[SPEED] *= VISCOUS if force else 1.0
        return IdentificationPrior(
            nominal, directions, command / torque if torque else command, terms, command
        )


def _root(torques: Array) -> float:
    """Root mean square over samples of (n,), or of (n, r) independent parts."""
    return float(np.sqrt(np.mean(np.sum(torques.reshape(len(torques), -1) ** 2, axis=1))))


def output_priors(
    spec: ArmSpec, tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array
) -> tuple[IdentificationPrior, ...]:
    """Prior of each output, over states spread within the robot's limits."""
    # more than twice as many states as parameters (10 a body): the rank is the tree's, not the draw's
    spread = spread_states(spec, 64 + 24 * tree.bodies)
    rigid, extra = command_regressors(tree, drives, friction_velocity, *spread)
    force = spec.command_unit in FORCES
    return tuple(
        IdentificationPrior.of_output(tree, rigid[:, j], extra[:, j], float(spec.command[j]), force)
        for j in range(spec.dof)
    )


def shared_directions(
    spec: ArmSpec, tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array
) -> Array:
    """(P, r) base directions of one rigid body for all outputs, z ~ N(0, 1) along each."""
    # more than twice as many states as parameters (10 a body): the rank is the tree's, not the draw's
    spread = spread_states(spec, 64 + 24 * tree.bodies)
    rigid, _ = command_regressors(tree, drives, friction_velocity, *spread)
    rows = (rigid / spec.command[:, None]).reshape(-1, rigid.shape[2])
    return MASSES_OFF * base_directions(rows, parameter_scale(tree))


def deviation_before_logs(rigid: Array, directions: Array, command: Array) -> Array:
    """(n, J) prior deviations of commands that are forces: of the masses, and of friction at top speed.

    Args:
        rigid: (n, J, P) regressors. directions: as of `shared_directions`. command: (J,) limits.
    """
    return np.asarray(np.sqrt(np.sum((rigid @ directions) ** 2, axis=2) + (VISCOUS * command) ** 2))


VISCOUS = 0.1
"""Prior deviation of viscous friction at top speed, as a part of the limit. A wider prior extrapolates the
Stribeck decrease of friction, which dominates slow motions, to the top speed.
"""
WAVE = 0.001
"""Prior deviation of each wave of a hinge's position, as a part of the limit: cables, bearings, cogging.
Without them a motion of small range attributes periodic torques to the masses.
"""
NO_TORQUE = 0.01
"""Part of the torque of masses as large as `parameter_scale`: a file with smaller masses counts as one
without.
"""
OFFSET = 0.005
"""Prior deviation of a force's offset, as a part of its limit: the zero of a torque sensor. A wider prior
absorbs the gravity of a motion of small range, and errs by as much elsewhere.
"""
MASSES_OFF = 0.3
"""Prior deviation of inertial parameters from the file's, as a part of `parameter_scale`: links seldom differ
by more, and a motion of small range hardly identifies masses.
"""


def _columns(
    regressors: Regressors, rows: Mask, prior: IdentificationPrior, body: RigidBody, j: int
) -> Array:
    """(n, 1 + E + r + W) columns of output j: nominal, extra, base directions, and friction for each
    presliding distance; without the last where the log carries no friction memory.
    """
    rigid, extra, turning, _ = regressors
    drive, v0 = body.drives[j], float(body.friction_velocity[j])
    inertial = rigid[rows, j]
    parts = [inertial @ prior.nominal[:, None], extra[rows, j], inertial @ prior.directions]
    if turning is not None and drive.side(j):
        parts.append(turned(turning[rows, :, j], extra[rows, j, SPEED], drive, j, v0))
    return np.concatenate(parts, axis=1)


def _fit_output(
    columns: Array, y: Array, prior: IdentificationPrior, weight: float, by_speed: float
) -> tuple[Array, Array, float, int, Array, float]:
    """phi (P,), extra (E,), residual deviation, rank, deviations (E,) of extra, and presliding distance of
    one output.

    First fits the nominal model with a free gain, then every base parameter with its prior about the nominal
    one. Both are repeated with friction by speed and with friction by each presliding distance. The least
    noise wins, where the noise with friction by speed is multiplied by `by_speed`.
    """
    moments, last = Moments.of(columns, y, weight), 1 + len(prior.extra)
    rank = prior.directions.shape[1]
    indices = np.arange(last + rank)
    fits = [(0.0, *_fit_turning(moments.at(indices), prior))]
    for number, distance in enumerate(PRESLIDING_DISTANCES[: columns.shape[1] - last - rank]):
        indices[1 + NARROW] = last + rank + number
        fits.append((distance, *_fit_turning(moments.at(indices), prior)))
    distance, fine, spread, noise = min(fits, key=lambda fit: fit[3] * (1.0 if fit[0] else by_speed))
    phi = fine[0] * prior.nominal + prior.directions @ fine[last:]
    return phi, fine[1:last], noise, rank, spread[1:last], distance


def _fit_turning(moments: Moments, prior: IdentificationPrior) -> tuple[Array, Array, float]:
    """Coefficients of nominal, extra and directions, their deviations, and the noise deviation."""
    deviations = np.concatenate([[prior.gain], prior.extra])
    coarse, spread, _ = moments.at(np.arange(len(deviations))).estimate(deviations, prior.command)
    gain = float(np.hypot(coarse[0], spread[0]))
    deviations = _near_level(deviations, coarse, first=1)
    every = np.concatenate([deviations, np.full(prior.directions.shape[1], gain)])
    return moments.estimate(every, prior.command)


def _near_level(deviations: Array, coarse: Array, first: int) -> Array:
    """Prior deviations in which those of the wider friction terms match the level of the `coarse`
    coefficients; both have the drive's terms from `first` on.

    A wider term is the change of the friction level from one scale of speed to the next.
    """
    narrowest, end = first + NARROW, first + NARROW + len(FRICTION_SCALES)
    level, narrowed = abs(float(np.sum(coarse[narrowest:end]))), deviations.copy()
    narrowed[narrowest + 1 : end] = np.minimum(narrowed[narrowest + 1 : end], LEVEL_CHANGE * level)
    return narrowed


RIPPLE_ROUNDS = 8
"""Number of alternations between the ripple's amplitude and the other parameters."""
OTHER_SCALE = 2.0
"""Largest ratio of a command's noise with the shared rigid body to that with separate parameters. Above it,
the command has another scale or sign than the others. Separate parameters also absorb errors of the friction
law: on a Kinova the ratio was 1.2 to 1.8, while the shared parameters had half the error on new motion.
"""
LEVEL_CHANGE = 0.25
"""Prior deviation of a change of the friction level, as a part of it. With few slow samples, terms of
opposite sign fit as well as one level, but err by the whole level at rest. Stiction exceeds Coulomb friction
by some ten per cent (Armstrong-Helouvry et al., Automatica 30, 1994).
"""
CLEARLY = 1.05
"""Ratio of noise above which one friction law is clearly worse. Below it, friction depends on presliding
distance if slow samples are masked, since gears deform before they slip. It depends on speed if slow samples
are used, since cross-validation chose them.
"""


@dataclass(frozen=True)
class Moments:
    """Normal equations of weighted columns C (n, P) and commands y (n,).

    Attributes:
        square: (P, P) C^T C. target: (P,) C^T y. power: y^T y. count: n, weighted.
    """

    square: Array
    target: Array
    power: float
    count: float

    @staticmethod
    def of(columns: Array, y: Array, weight: float) -> Moments:
        """The normal equations with each sample multiplied by `weight`."""
        square, target = weight * columns.T @ columns, weight * columns.T @ y
        return Moments(square, target, weight * float(y @ y), weight * len(y))

    def at(self, places: NDArray[np.int64]) -> Moments:
        """The normal equations of those columns alone."""
        return Moments(self.square[np.ix_(places, places)], self.target[places], self.power, self.count)

    def estimate(self, deviations: Array, command: float) -> tuple[Array, Array, float]:
        """Coefficients with independent priors N(0, deviations^2), their posterior deviations, and the noise
        deviation.

        The noise is found by fixed-point iteration on the residual (MacKay 1992), between 0.01 % and 10 % of
        the command limit.
        """
        moment, target = self.square * np.outer(deviations, deviations), self.target * deviations
        eigenvalues, vectors = np.linalg.eigh(moment)
        eigenvalues = np.maximum(eigenvalues, 0.0)
        rotated = vectors.T @ target
        # fixed-point iteration from 1 % of the command limit; it converges within a dozen steps
        noise = (0.01 * command) ** 2
        for _ in range(12):
            z = rotated / (eigenvalues + noise)
            determined = float(np.sum(eigenvalues / (eigenvalues + noise)))
            freedom = max(self.count - determined, 1.0)
            squared_residual = self.power - 2.0 * float(z @ rotated) + float(z @ (eigenvalues * z))
            # no drive repeats better than the lower bound; above the upper one the law is wrong
            noise = float(np.clip(squared_residual / freedom, (1e-4 * command) ** 2, (0.1 * command) ** 2))
        variance = (vectors**2) @ (noise / (eigenvalues + noise))
        return deviations * (vectors @ z), deviations * np.sqrt(variance), float(np.sqrt(noise))


NOISE_ROUNDS = 6
"""Number of alternations between noise and parameters; after four the noise changes by less than 0.1 %."""
LEAST_NOISE, MOST_NOISE = 1e-4, 0.1
"""Parts of the command limit: bounds of the noise deviation."""


@dataclass(frozen=True)
class OutputColumns:
    """The data of one command at the n samples in which its joint moves.

    Attributes:
        columns: (n, r + E) regressors of the rigid body along the directions D, and of the drive.
        residual: (n,) command minus the torque of phi_0.
        deviations: (E,) prior deviations of the drive's terms.
        noise: initial deviation, command units.
        clock: of the samples.
    """

    columns: Array
    residual: Array
    deviations: Array
    noise: float
    clock: Clock


@dataclass(frozen=True)
class SharedFit:
    """z (r,) of all commands, extra (J, E) of the drives, noise (J,), weight (J,) of one sample, and the
    covariance of (z, e_1 .. e_J).
    """

    z: Array
    extra: Array
    noise: Array
    weight: Array
    covariance: Array

    @property
    def spread(self) -> Array:
        """(J, E) posterior deviations of extra."""
        variance = self.covariance.diagonal()[len(self.z) :]
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)).reshape(self.extra.shape))


def shared_fit(outputs: Sequence[OutputColumns], r: int, limits: Array) -> SharedFit:
    """Maximum a posteriori z and e; noise of each command and its correlation time, from its residual.

    Args:
        r: directions of the rigid body. limits: (J,) command limits.
    """
    grams = [(o.columns.T @ o.columns, o.columns.T @ o.residual) for o in outputs]
    noise, weight = np.array([o.noise for o in outputs]), np.array([o.clock.information() for o in outputs])
    for _ in range(NOISE_ROUNDS):
        x, covariance = _solved(grams, outputs, weight / noise**2, r)
        extra = x[r:].reshape(len(outputs), -1)
        residuals = [
            o.residual - o.columns @ np.append(x[:r], e) for o, e in zip(outputs, extra, strict=True)
        ]
        noise = np.array([np.sqrt(np.mean(one**2)) for one in residuals])
        noise = np.clip(noise, LEAST_NOISE * limits, MOST_NOISE * limits)
        weight = np.array([o.clock.information(one) for o, one in zip(outputs, residuals, strict=True)])
    return SharedFit(x[:r], extra, noise, weight, covariance)


def _solved(
    grams: Sequence[tuple[Array, Array]], outputs: Sequence[OutputColumns], precision: Array, r: int
) -> tuple[Array, Array]:
    """Means and covariance of (z, e_1 .. e_J), scaled by the prior so that the matrix is well conditioned."""
    E = len(outputs[0].deviations)
    scale = np.concatenate([np.ones(r), *(o.deviations for o in outputs)])
    A, b = np.zeros((len(scale), len(scale))), np.zeros(len(scale))
    for j, (square, target) in enumerate(grams):
        place = np.concatenate([np.arange(r), r + j * E + np.arange(E)])
        A[np.ix_(place, place)] += precision[j] * square
        b[place] += precision[j] * target
    inverse: Array = np.linalg.inv(A * np.outer(scale, scale) + np.eye(len(scale))).astype(np.float64)
    return scale * (inverse @ (scale * b)), inverse * np.outer(scale, scale)


TURNED = 0.3
"""s before and after a reversal, in which filters smear the step of friction: a period of their cutoff."""
ENOUGH = 0.3
"""Least share of a joint's samples that must remain; otherwise reversals are not excluded."""


def steady(samples: Samples, *turning: Array) -> Mask:
    """(n, J) samples in which a joint moves away from reversals of each quantity (n, J), as its speed, and
    from its zeros, as of a command within the dead band; all moving samples if too few remain.
    """
    moving = samples.moving & samples.usable
    mask = moving.copy()
    for one in turning:
        mask &= (since_reversal(samples.t, samples.group, one) > TURNED) & (one != 0.0)
    return np.where(mask.sum(axis=0) > ENOUGH * moving.sum(axis=0), mask, moving)


def since_reversal(t: Array, group: Index, speed: Array) -> Array:
    """(n, J) s to the nearest change of the sign of a joint's speed (n, J) within the same group."""
    clock = t + 10.0**6 * group  # longer than any log
    seconds = np.full(speed.shape, np.inf)
    for j, sign in enumerate(np.sign(speed).T):
        turns = np.flatnonzero((sign[1:] != sign[:-1]) & (group[1:] == group[:-1]))
        times = np.concatenate([[-np.inf], np.sort(0.5 * (clock[turns] + clock[turns + 1])), [np.inf]])
        after = np.searchsorted(times, clock)
        seconds[:, j] = np.minimum(times[after] - clock, clock - times[after - 1])
    return seconds
