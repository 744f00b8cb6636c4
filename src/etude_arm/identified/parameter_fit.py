"""Estimates of a robot's parameters from logs: base parameters and each drive's terms, with intervals.

The estimate is that of `physics.identification`, with textbook friction terms instead of the model's. Waves
of each hinge's position describe cogging, which gravity would otherwise absorb:

    command_j = rigid_j(phi) + armature l'' + viscous l' + asymmetry |l'| + offset + ripple(q_j)
              + [coulomb + stribeck exp(-(l'/v_s)^2) + load |rigid_j|] s + delay d command_j / dt
              + dead_band tanh(command_j / noise)
              - sum_k backlash_k/2 tanh(rigid_k / noise) d rigid_j / d q_k

with s = tanh(l'/v0). Commands act some ms after they are logged: one delay is common to all. Without it the
rates of gravity and of inertial forces pass for friction and armature. v_s and v0 are estimated with all else
by Gauss and Newton: a shape taken as known makes intervals of Coulomb and viscous friction far too narrow.
Friction by load and by direction is kept only where the logs show it: the density of the value 0 before the
logs and after them gives the evidence (Savage and Dickey). Stribeck's dip is kept unless it is below zero.
Commands within the dead band make no torque. An encoder at the motor is half the backlash ahead of the link,
on the side that the force decides; gravity shows where the link is. Both are kept where the logs show them,
which needs forces against the motion. Where a joint turned round a moment ago the filter has smeared the step
of its friction, and samples are left out.

Deviations do not rely on the noise model: they use the scatter of the score between stretches of log longer
than the correlation time (`models.scatter`), and are at least half of the posterior deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr, logsumexp

from etude.models.scatter import scattered
from etude.types import Array, Mask, Samples
from etude_arm.physics.base_parameters import parameter_scale, spread_states
from etude_arm.physics.identification import (
    LEVEL_CHANGE,
    MASSES_OFF,
    OFFSET,
    RIPPLE_ROUNDS,
    Clock,
    IdentificationPrior,
    OutputColumns,
    SharedFit,
    output_priors,
    shared_directions,
    shared_fit,
    steady,
)
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.physics.rigid_body import NARROW, SPEED, command_regressors, waves
from etude_arm.spec import COMMAND_RATES, FORCES, PATH, PLAN, RIPPLES, ArmSpec

TERMS = (
    "armature", "viscous", "coulomb", "stribeck", "load", "asymmetry", "offset", "dead band", "backlash",
)  # fmt: skip
E = len(TERMS) - 1
"""Terms of one drive alone: backlash shows in the commands of all joints before it."""
VISCOUS, COULOMB, STRIBECK, LOAD = 1, 2, 3, 4
"""Indices of these terms."""
FRICTION, OFFSET_TERM = slice(1, 6), 6
DEAD_BAND, BACKLASH_TERM, LOST = 7, 8, slice(7, 9)
"""Indices of the dead band, of the backlash, and of both."""
WAVES = slice(E, E + 2 * RIPPLES)
OPTIONAL = slice(4, 6)
"""Terms that are dropped if the logs do not support them."""
POSITIVE = slice(3, 5)
"""Terms that cannot be negative: stiction exceeds sliding friction, and a load increases friction of the
gear.
"""
SHOWN = 3.0
"""Nats from which a term is kept: 20 to 1."""
STRIBECK_SPEEDS = (2.0, 4.0, 8.0, 16.0)
"""v_s to begin with, in v0 of the model's friction."""
TURNS = (0.1, 0.3, 1.0, 3.0)
"""v0 to begin with, in that of the model's friction."""
SHAPE = 1.0
"""Prior deviation of log v_s and log v0: drives differ by a factor of e."""
SHAPE_ROUNDS = 3
"""Of Gauss and Newton; after two the speeds change by some per cent."""
LONGEST_STEP = 0.7
"""Of log v_s and log v0 in one round: farther the columns are no derivatives any more."""
SLOWEST_SHAPE, FASTEST_SHAPE = (1.0, 0.05), (32.0, 4.0)
"""Bounds of v_s and v0, in v0 of the model's friction: just outside the values to begin with."""
ROTOR = 0.03
"""Prior armature as a part of the inertia that the command limit accelerates at the robot's limits: the rotor
of a wrist far exceeds its link.
"""
LOAD_FRICTION = 0.3
"""Prior deviation of load-dependent friction, as a part of the load: gears lose some ten per cent."""
BAND = 0.03
"""Prior deviation of a dead band, as a part of the command limit: PWM stages of servos lose some per cent."""
BACKLASH = 0.05
"""Prior deviation of the backlash, rad: cheap gears have one to three degrees."""
BAND_ROUNDS = 3
"""Fits, each with the sign of the command that the last one predicts; after two, few signs change."""
SMALL_TURN = 1e-4
"""rad (m) for differences: far above rounding, far below what bends the torques."""
DELAY = 0.01
"""Prior deviation of the delay, s: some cycles of a controller. Logs that are later are shifted before."""
STRETCHES = 2.0
"""Correlation times of the residual in one stretch of log, so that scores are nearly independent."""
LEAST_STRETCH = 1.0  # s
LEAST_SCATTER = 0.25
"""Of the posterior's variance."""


@dataclass(frozen=True, eq=False)
class Friction:
    """Terms of the drives.

    Attributes:
        terms, deviation: (J, E) by `TERMS`. evidence: (J, E) nats for each of them.
        stribeck_speed, v0: (J,) rad/s (m/s) over which Stribeck's dip ends, and friction turns.
    """

    terms: Array
    deviation: Array
    evidence: Array
    stribeck_speed: Array
    v0: Array


@dataclass(frozen=True, eq=False)
class ParameterFit:
    """The parameters theta: inertial parameters body after body, then the armature of each drive.

    Attributes:
        theta, nominal: (P + J,) estimates, and the file's values. before, after: (P + J, P + J) prior and
            posterior covariance.
        shown: (N, P + J) regressor of theta over the robot's limits: what any motion could identify.
        scale: (P + J,) prior scale of each about the file's value.
        friction: of the drives.
        own_scale: (J,) commands that the shared rigid body does not explain, so they identify no mass.
        delay: s from a logged command to its effect, and its deviation.
    """

    theta: Array
    nominal: Array
    before: Array
    after: Array
    shown: Array
    scale: Array
    friction: Friction
    own_scale: Mask
    delay: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Settled:
    """The regression as it was settled.

    Attributes:
        outputs: of each command, its columns [r of the rigid body and the delay, `TERMS`, ripple].
        speeds: (2, J) v_s and v0, rad/s (m/s).
        evidence, prior: (J, terms) nats for each of `TERMS`; (J, E) its deviation before any data.
        cogs: (J,) whether the logs show cogging. dropped: (J, E) terms that are left out.
    """

    problem: Problem
    fit: SharedFit
    outputs: list[OutputColumns]
    speeds: Array
    evidence: Array
    prior: Array
    cogs: Mask
    dropped: Mask

    @property
    def command(self) -> Array:
        """(n, J) commands of the samples, when they take effect, without what backlash adds."""
        command, rate = self.problem.late
        behind = self.problem.loose @ (BACKLASH * self.fit.z[self.problem.gears])
        return np.asarray(command - DELAY * self.fit.z[-1] * rate - behind)


def settled(samples: Samples, spec: ArmSpec, mean: RigidBodyMean) -> Settled:
    """Fits all samples; mean: the identified physics of the same samples, for friction, noise and scale."""
    start = Problem.of(samples, spec, mean)
    result = _settled(start.with_ripple())
    problem, nats = _nats_of_lost(start, result)
    has = HAS[np.argmax(nats - SHOWN * HAS.sum(axis=1)[:, None], axis=0)]
    if has.any():
        # backlash of one joint shows in the commands of others: all have it, or none
        has[:, 1] = has[:, 1].any()
        result = _settled(problem.only(has))
        more = has[:, 0] & ((result.fit.extra[:, COULOMB] < 0.0) | (_nats_of_band(result) < SHOWN))
        if more.any():
            # the dead band is all of Coulomb friction, or nothing: the data do not separate the two
            nats[:, more] = 0.0
            has[:, 0] &= ~more
            result = _settled(problem.only(has))
    # what the terms explain together belongs to neither
    result.evidence[:, LOST] = np.transpose(
        [logsumexp(nats[has], axis=0) - logsumexp(nats[~has], axis=0) for has in HAS.T]
    )
    return result


def _settled(problem: Problem) -> Settled:
    speeds = _shape(problem, ())
    fit, _ = problem.fitted(speeds)
    fit, outputs = problem.fitted(speeds, None, fit.extra[:, :E])
    prior = np.array([o.deviations[:E] for o in outputs])
    evidence = np.zeros((problem.spec.dof, len(TERMS)))
    evidence[:, :E] = savage_dickey(fit.extra[:, :E], fit.spread[:, :E], prior)
    evidence[:, STRIBECK] = _nats_of_dip(problem, speeds, fit)
    dropped = np.zeros(prior.shape, dtype=bool)
    dropped[:, OPTIONAL] = evidence[:, OPTIONAL] < SHOWN
    dropped[:, DEAD_BAND] = ~problem.band.any(axis=0)
    dropped[:, POSITIVE] |= fit.extra[:, POSITIVE] < 0.0
    nats = np.array([_nats_of_waves(fit, j, float(size)) for j, size in enumerate(problem.ripple)])
    fit, outputs, dropped = _without_rise(problem, speeds, dropped)
    return Settled(problem, fit, outputs, speeds, evidence, prior, nats > SHOWN, dropped)


HAS = np.array([[False, False], [True, False], [False, True], [True, True]])
"""Explanations of lost motion: nothing, dead band, backlash, both."""


def _nats_of_lost(start: Problem, result: Settled) -> tuple[Problem, Array]:
    """The regression with dead band and backlash, and (4, J) nats for each of `HAS` over nothing."""
    problem, fit, outputs = result.problem, result.fit, result.outputs
    dropped = result.dropped.copy()
    dropped[:, DEAD_BAND] = False
    for _ in range(BAND_ROUNDS):
        band = fit.extra[:, DEAD_BAND]
        problem = start.pushed_by(problem.predicted(fit, outputs), fit.noise, band).with_ripple()
        fit, outputs = problem.fitted(result.speeds, dropped)
    nats = np.zeros((len(HAS), problem.spec.dof))
    for k, has in enumerate(HAS[1:], start=1):
        fit, outputs = problem.only(has).fitted(result.speeds, dropped)
        if has[1]:
            z, after = fit.z[problem.gears], fit.covariance.diagonal()[: len(fit.z)][problem.gears]
            nats[k] = _nats_of_positive(z, np.sqrt(after), np.ones_like(z))
        else:
            prior = np.array([output.deviations[DEAD_BAND] for output in outputs])
            nats[k] = _nats_of_positive(fit.extra[:, DEAD_BAND], fit.spread[:, DEAD_BAND], prior)
    nats[3] += nats[1]
    return problem, nats


def _nats_of_band(result: Settled) -> Array:
    """(J,) for the dead band in the fit that has it; 0 of joints without one."""
    value, spread = (part[:, DEAD_BAND] for part in (result.fit.extra, result.fit.spread))
    nats = np.zeros(len(value))
    has = spread > 0.0
    nats[has] = _nats_of_positive(value[has], spread[has], result.prior[has, DEAD_BAND])
    return nats


def _nats_of_positive(value: Array, deviation: Array, prior: Array) -> Array:
    """As `savage_dickey`, for a term whose prior is the positive half of the normal one."""
    half = np.log(2.0) + log_ndtr(value / deviation)
    return np.asarray(savage_dickey(value, deviation, prior) + half)


def _shape(problem: Problem, without: Sequence[int]) -> Array:
    """(2, J) v_s and v0, without some terms: those of the least noise, then those where all is fitted."""
    J = problem.spec.dof
    none = np.zeros((J, E), dtype=bool)
    none[:, list(without)] = True
    grid = np.array([problem.speeds_of(slow, part) for part in TURNS for slow in STRIBECK_SPEEDS])
    noises = [_without_rise(problem, speeds, none)[0].noise for speeds in grid]
    speeds = grid[np.argmin(noises, axis=0), :, np.arange(J)].T
    bounds = problem.speeds_of(*SLOWEST_SHAPE), problem.speeds_of(*FASTEST_SHAPE)
    for _ in range(SHAPE_ROUNDS):
        fit, _, dropped = _without_rise(problem, speeds, none)
        fit, _ = problem.fitted(speeds, dropped, fit.extra[:, :E])
        step = np.clip(fit.extra[:, -2:].T, -LONGEST_STEP, LONGEST_STEP)
        speeds = np.clip(speeds * np.exp(step), *bounds)
    return np.asarray(speeds)


def _nats_of_dip(problem: Problem, speeds: Array, fit: SharedFit) -> Array:
    """(J,) for a dip against a friction that may turn at any speed instead (Schwarz 1978: two parameters)."""
    without = np.zeros((problem.spec.dof, E), dtype=bool)
    without[:, STRIBECK] = True
    other, _ = problem.fitted(_shape(problem, (STRIBECK,)), without)
    least, _, _ = _without_rise(problem, speeds, np.zeros_like(without))
    count = fit.weight * problem.used.sum(axis=0)
    return np.asarray(count * np.log(other.noise / least.noise) - np.log(np.maximum(count, 1.0)))


def _without_rise(
    problem: Problem, speeds: Array, dropped: Mask, bent: Array | None = None
) -> tuple[SharedFit, list[OutputColumns], Mask]:
    """The fit in which no drive sticks less than it slides: a dip below zero would stand for a wider v0."""
    fit, outputs = problem.fitted(speeds, dropped, bent)
    rises = fit.extra[:, STRIBECK] < 0.0
    if not rises.any():
        return fit, outputs, dropped
    without = dropped.copy()
    without[:, STRIBECK] |= rises
    return *problem.fitted(speeds, without, bent), without


def _nats_of_waves(fit: SharedFit, j: int, prior: float) -> float:
    """As `savage_dickey`, for all waves of one output together; 0 without a prior."""
    if prior == 0.0:
        return 0.0
    value, (r, width) = fit.extra[j, WAVES], (len(fit.z), fit.extra.shape[1])
    block = slice(r + j * width + WAVES.start, r + j * width + WAVES.stop)
    covariance = fit.covariance[block, block]
    change = 2.0 * len(value) * np.log(prior) - np.linalg.slogdet(covariance)[1]
    return float(0.5 * (value @ np.linalg.solve(covariance, value) - change))


def savage_dickey(value: Array, deviation: Array, prior: Array) -> Array:
    """Evidence for a term in nats: the log ratio of prior to posterior density at 0."""
    return np.asarray(0.5 * (value / deviation) ** 2 - np.log(prior / deviation))


def slopes_of_shape(speed: Array, slow: Array, turns: Array, level: Array, dip: Array) -> Array:
    """(..., 2) derivatives of the friction [level(speed)] tanh(speed / turns) by log slow and log turns.

    Args:
        level: of friction at that speed, with what is left of the dip; dip: what Stribeck's adds at rest.
    """
    sign, part = np.tanh(speed / turns), (speed / slow) ** 2
    longer = dip * np.exp(-part) * 2.0 * part * sign
    steeper = -level * speed / turns * (1.0 - sign**2)
    return np.stack([longer, steeper], axis=-1)


@dataclass(frozen=True, eq=False)
class Problem:
    """Regressors of samples and robot.

    Attributes:
        rigid: (n, J, P); drive: (n, J, E + waves), zero where the shape of friction decides. speed, load:
            (n, J) of the drive, and size of what the rigid body takes.
        rates: two (n, J), the commands' derivatives; zero where samples do not carry them.
        directions: (P, r) of the shared rigid body, the last of them zero: that of the delay. shared: (J,)
            commands that the rigid body explains.
        armature: (J,) prior deviation: the inertia of the links at the drive, or `ROTOR`.
        ripple: (J,) prior deviation of each wave of a joint's position.
        separate: (J,) unit of a command with a rigid body of its own per N m; zero where it is shared.
        slope: (n, J, J) of the rigid commands by the position of each hinge with a drive of its own, on the
            side of its drive; zero of others.
        band: (n, J) column of the dead band; loose: (n, J, J) commands per backlash of each joint. Zero where
            they are left out.
        pushed: (n, J, 2) command and rigid command, whose signs made them.
        delay: s that commands are taken to act later; a change of it is estimated with all else.
    """

    samples: Samples
    spec: ArmSpec
    mean: RigidBodyMean
    rigid: Array
    drive: Array
    speed: Array
    load: Array
    rates: tuple[Array, Array]
    priors: tuple[IdentificationPrior, ...]
    directions: Array
    shared: Mask
    armature: Array
    ripple: Array
    separate: Array
    slope: Array
    band: Array
    loose: Array
    pushed: Array
    delay: float = 0.0

    @staticmethod
    def of(samples: Samples, spec: ArmSpec, mean: RigidBodyMean) -> Problem:
        model = mean.model
        body = (model.tree, model.drives, model.friction_velocity)
        rigid, extra = command_regressors(*body, *(samples.log[n] for n in (PLAN if mean.desired else PATH)))
        same = np.isclose(model.inertial[:, None], model.inertial[None], rtol=1e-9).all(axis=2)
        shared = (same.sum(axis=1) > min(1, spec.dof - 1)) & (spec.command_unit in FORCES)
        one_body = shared_directions(spec, *body)
        speed = extra[..., SPEED]
        load = np.abs(np.einsum("njp,jp->nj", rigid, model.inertial))
        none = np.zeros_like(speed)
        drive = [extra[..., 0], speed, none, none, none, np.abs(speed), np.ones_like(speed), none]
        q, hinges = samples.log[(PLAN if mean.desired else PATH)[0]], ~model.tree.joint_slides
        drive += [hinges * wave for wave in np.moveaxis(waves(q), 2, 0)]
        if not shared.all():
            drive += [~shared * column for column in np.moveaxis(rigid @ one_body, 2, 0)]
        late = np.zeros((rigid.shape[2], spec.dof + 1))
        directions = np.hstack([one_body, late]) if shared.any() else late
        priors = output_priors(spec, *body)
        ripple = model.deviation * hinges
        rotor = ROTOR * np.array([prior.extra[0] for prior in priors])
        armature = np.maximum(_inertia(spec, mean, model.inertial), rotor)
        rates = (samples.log.get(name) for name in COMMAND_RATES)
        first, second = (none if rate is None else rate for rate in rates)
        parts = (
            rigid,
            np.stack(drive, 2),
            speed,
            load,
            (first, second),
            priors,
            directions,
            shared,
            armature,
            ripple,
            ~shared * _gains(rigid, model.inertial, priors),
            _slope(spec, mean, samples),
            none,
            np.zeros((*speed.shape, spec.dof)),
            np.ones((*speed.shape, 2)),
        )
        return Problem(samples, spec, mean, *parts)

    def predicted(self, fit: SharedFit, outputs: Sequence[OutputColumns]) -> Array:
        """(n, J) commands by the fit; as they are logged in samples that it does not use."""
        commands = self.late[0].copy()
        for j, output in enumerate(outputs):
            nominal = self.late[0][self.used[:, j], j] - output.residual
            commands[self.used[:, j], j] = nominal + output.columns @ np.append(fit.z, fit.extra[j])
        return commands

    def pushed_by(self, command: Array, noise: Array, band: Array) -> Problem:
        """The regression with dead band and backlash, for predicted commands (n, J), their noise (J,) and the
        dead bands (J,) known so far, within which no command has a direction.
        """
        rigid = np.einsum("njp,jp->nj", self.rigid, self.mean.model.inertial)
        loose = -0.5 * np.tanh(rigid / noise)[:, None] * self.slope
        pushed = np.stack([np.where(np.abs(command) > band, command, 0.0), rigid], axis=2)
        return replace(self, band=np.tanh(command / noise), loose=loose, pushed=pushed)

    def only(self, has: Mask) -> Problem:
        """The regression with the dead bands and backlashes of `has`, (2,) or (J, 2), alone."""
        return replace(self, band=self.band * has[..., 0], loose=self.loose * has[..., 1])

    @property
    def gears(self) -> slice:
        """Of the backlashes in z, in `BACKLASH`."""
        return slice(-1 - self.spec.dof, -1)

    def with_ripple(self) -> Problem:
        """The regression with the amplitude of the waves, by expectation maximisation, and with the delay."""
        problem = self
        for _ in range(RIPPLE_ROUNDS):
            fit, _ = problem.fitted(self.speeds_of(STRIBECK_SPEEDS[0], 1.0))
            squares = fit.extra[:, WAVES] ** 2 + fit.spread[:, WAVES] ** 2
            delay = problem.delay + DELAY * float(fit.z[-1])
            problem = replace(problem, ripple=np.sqrt(squares.mean(axis=1)), delay=delay)
        return problem

    @property
    def late(self) -> tuple[Array, Array]:
        """(n, J) commands at the time at which they act, to second order in the delay, and their rate."""
        first, second = self.rates
        command = self.samples.command - self.delay * first + 0.5 * self.delay**2 * second
        return np.asarray(command), np.asarray(first - self.delay * second)

    def fitted(
        self, speeds: Array, dropped: Mask | None = None, bent: Array | None = None
    ) -> tuple[SharedFit, list[OutputColumns]]:
        """With friction of this shape, and without the terms (J, E) that are dropped.

        Args:
            speeds: (2, J) v_s and v0, rad/s (m/s).
            bent: (J, E) terms at which changes of log v_s and log v0 are estimated too, as columns behind all
                others. None: the shape is known.
        """
        slow, turns = speeds
        sign, dip, load = np.tanh(self.speed / turns), np.exp(-((self.speed / slow) ** 2)), self.load
        drive = self.drive.copy()
        drive[..., COULOMB : LOAD + 1] = np.stack([sign, dip * sign, load * sign], axis=2)
        drive[..., DEAD_BAND] = self.band
        if bent is not None:
            level = bent[:, COULOMB] + bent[:, STRIBECK] * dip + bent[:, LOAD] * load
            slopes = slopes_of_shape(self.speed, slow, turns, level, bent[:, STRIBECK])
            drive = np.concatenate([drive, slopes], axis=2)
        outputs = [self._output(j, drive[:, j]) for j in range(self.spec.dof)]
        if dropped is not None:
            retained = np.pad(~dropped, ((0, 0), (0, drive.shape[2] - E)), constant_values=True)
            pairs = zip(outputs, retained, strict=True)
            outputs = [replace(o, deviations=np.where(keep, o.deviations, 0.0)) for o, keep in pairs]
        limits = np.array([prior.command for prior in self.priors])
        return shared_fit(outputs, self.directions.shape[1], limits), outputs

    @cached_property
    def used(self) -> Mask:
        """(n, J) samples in which the joint moves away from reversals, of lost motion too."""
        diagonal = np.einsum("njj->nj", self.loose)
        lost = np.stack([self.band.any(axis=0), diagonal.any(axis=0)], axis=1)
        pushed = np.where(lost, self.pushed, 1.0)
        return steady(self.samples, self.speed, *np.moveaxis(pushed, 2, 0))

    def speeds_of(self, slow: float, turns: float) -> Array:
        """(2, J) v_s and v0, as parts of the v0 of the model's friction."""
        v0 = np.array([self.turns_over(j) for j in range(self.spec.dof)])
        return np.array([slow * v0, turns * v0])

    def turns_over(self, j: int) -> float:
        """v0 of the drive."""
        drive = self.mean.model.drives[j]
        moment = np.abs(drive.gear * drive.coefficients)
        v0 = self.mean.model.friction_velocity
        return float(moment @ v0) if moment.any() else float(v0[j])

    def _output(self, j: int, drive: Array) -> OutputColumns:
        prior, samples, model = self.priors[j], self.samples, self.mean.model
        rows = self.used[:, j]
        # not the fitted parameters: these samples made them, without dead band, and the prior is narrow
        nominal = prior.nominal * (1.0 if self.shared[j] else self.separate[j])
        rigid = self.rigid[rows, j] @ self.directions * float(self.shared[j])
        command, rate = (part[rows, j] for part in self.late)
        rigid[:, -1] = DELAY * rate
        rigid[:, self.gears] = BACKLASH * self.loose[rows, j]
        level = abs(float(np.sum(model.extra[j, NARROW:-1])))
        _, viscous, coulomb, *_, offset = prior.extra
        offset = min(offset, OFFSET * prior.command)
        deviations = np.array(
            [self.armature[j], viscous, coulomb, level, LOAD_FRICTION, LEVEL_CHANGE * viscous, offset, 0.0]
        )
        deviations[DEAD_BAND] = BAND * prior.command
        deviations = np.append(deviations, np.full(2 * RIPPLES, self.ripple[j]))
        if not self.shared.all():
            deviations = np.append(
                deviations, np.full(self.drive.shape[2] - len(deviations), abs(self.separate[j]))
            )
        deviations = np.append(deviations, np.full(drive.shape[1] - len(deviations), SHAPE))
        clock = Clock(samples.t[rows], samples.group[rows])
        residual = command - self.rigid[rows, j] @ nominal
        return OutputColumns(
            np.concatenate([rigid, drive[rows]], axis=1), residual, deviations, model.deviation[j], clock
        )


def _gains(rigid: Array, inertial: Array, priors: Sequence[IdentificationPrior]) -> Array:
    """(J,) by which the file's rigid commands are nearest to those of the parameters (J, P)."""
    file, most = rigid @ priors[0].nominal, np.array([prior.gain for prior in priors])
    gains = np.sum(np.einsum("njp,jp->nj", rigid, inertial) * file, axis=0) / np.sum(file**2, axis=0)
    return np.asarray(np.clip(gains, -most, most))


def _slope(spec: ArmSpec, mean: RigidBodyMean, samples: Samples) -> Array:
    """(n, J, J) as of `Problem.slope`."""
    model = mean.model
    q, qd, qdd = (samples.log[name] for name in (PLAN if mean.desired else PATH))
    body = (model.tree, model.drives, model.friction_velocity)
    slopes = np.zeros((*q.shape, spec.dof))
    for k, drive in enumerate(model.drives):
        if model.tree.joint_slides[k] or not drive.side(k):
            continue
        step = SMALL_TURN * (np.arange(spec.dof) == k)
        ends = (command_regressors(*body, q + side * step, qd, qdd)[0] for side in (1.0, -1.0))
        more, less = (np.einsum("njp,jp->nj", rigid, model.inertial) for rigid in ends)
        slopes[..., k] = drive.side(k) * (more - less) / (2.0 * SMALL_TURN)
    return slopes


def widened(fit: SharedFit, outputs: Sequence[OutputColumns]) -> Array:
    """The covariance of (z, e_1 .. e_J) by the scatter of the score."""
    prior = np.concatenate([np.ones(len(fit.z)), *(o.deviations for o in outputs)])
    free = prior > 0.0
    posterior, scores = fit.covariance[np.ix_(free, free)], _scores(fit, outputs)[:, free]
    covariance = np.zeros_like(fit.covariance)
    covariance[np.ix_(free, free)] = scattered(posterior, prior[free], scores, LEAST_SCATTER)
    return covariance


def _scores(fit: SharedFit, outputs: Sequence[OutputColumns]) -> Array:
    """(stretches, r + J E): the gradients of the log likelihood, of stretches of all commands together."""
    r, width = len(fit.z), fit.extra.shape[1]
    residuals = [
        o.residual - o.columns @ np.append(fit.z, e) for o, e in zip(outputs, fit.extra, strict=True)
    ]
    memory = max(o.clock.correlation_time(residual) for o, residual in zip(outputs, residuals, strict=True))
    stretch = max(LEAST_STRETCH, STRETCHES * memory)
    # more stretches than any log has
    places = [o.clock.group * 10.0**6 + np.floor(o.clock.t / stretch) for o in outputs]
    stretches = np.unique(np.concatenate(places))
    scores = np.zeros((len(stretches), r + len(outputs) * width))
    for j, (o, residual, place) in enumerate(zip(outputs, residuals, places, strict=True)):
        gradients = fit.weight[j] / fit.noise[j] ** 2 * residual[:, None] * o.columns
        row = np.searchsorted(stretches, place)
        np.add.at(scores[:, :r], row, gradients[:, :r])
        np.add.at(scores[:, r + j * width : r + (j + 1) * width], row, gradients[:, r:])
    return scores


def parameter_fit(result: Settled) -> ParameterFit:
    """The drives' terms, and theta with its covariances."""
    problem, prior = result.problem, result.prior
    # with the shape's own uncertainty
    fit, outputs, _ = _without_rise(problem, result.speeds, result.dropped, result.fit.extra[:, :E])
    covariance = widened(fit, outputs)
    D, (J, width) = problem.directions, fit.extra.shape
    P, r = D.shape
    back = np.zeros((P + J, len(covariance)))
    back[:P, :r] = D
    back[P + np.arange(J), r + np.arange(J) * width] = 1.0
    nominal = np.append(problem.priors[0].nominal, np.zeros(J))
    # by the file alone, so that two campaigns of a robot name the same combinations
    armature = _inertia(problem.spec, problem.mean, np.tile(nominal[:P], (J, 1)))
    theta = nominal + back @ np.concatenate([fit.z, fit.extra.ravel()])
    every = np.zeros(fit.extra.shape)
    every[:, :E] = prior
    before = np.concatenate([np.ones(r), every.ravel()]) ** 2
    spread = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    deviation, gears = spread[r:].reshape(J, width), spread[:r][problem.gears]
    loose = BACKLASH * problem.loose.any(axis=(0, 1))
    terms = np.column_stack([fit.extra[:, :E], loose * fit.z[problem.gears]])
    friction = Friction(
        terms, np.column_stack([deviation[:, :E], loose * gears]), result.evidence, *result.speeds
    )
    return ParameterFit(
        theta,
        nominal,
        (back * before) @ back.T,
        back @ covariance @ back.T,
        _shown(problem),
        np.append(MASSES_OFF * parameter_scale(problem.mean.model.tree), armature),
        friction,
        ~problem.shared,
        (problem.delay + DELAY * float(fit.z[-1]), DELAY * float(np.sqrt(covariance[r - 1, r - 1]))),
    )


def _inertia(spec: ArmSpec, mean: RigidBodyMean, inertial: Array) -> Array:
    """(J,) command per rad/s^2 (m/s^2) of a drive, for links with these parameters (J, P), over the robot's
    limits.
    """
    model = mean.model
    body = (model.tree, model.drives, model.friction_velocity)
    q, _, qdd = spread_states(spec, 64 + 24 * model.tree.bodies)
    still = np.zeros_like(q)
    (moved, extra), (static, _) = (command_regressors(*body, q, still, a) for a in (qdd, still))
    torque = np.einsum("njp,jp->nj", moved - static, inertial)
    return np.asarray(np.sqrt(np.mean(torque**2, axis=0) / np.mean(extra[..., 0] ** 2, axis=0)))


def _shown(problem: Problem) -> Array:
    """(N, P + J) of the shared commands, each by its limit, over states within the robot's limits."""
    model, spec = problem.mean.model, problem.spec
    states = spread_states(spec, 64 + 24 * model.tree.bodies)
    rigid, extra = command_regressors(model.tree, model.drives, model.friction_velocity, *states)
    armature = extra[..., 0][..., None] * np.eye(spec.dof)
    rows = np.concatenate([rigid, armature], axis=2) / spec.command[:, None]
    return np.asarray(rows[:, problem.shared].reshape(-1, rows.shape[2]))
