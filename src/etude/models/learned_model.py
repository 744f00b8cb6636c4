"""LearnedModel: commands from states, for each command by the structure that was selected for it.

How well a model knows its commands is found of the inputs that the processes are conditioned on, so that
models on disk of any age tell it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from etude.abilities import SupportsColumns
from etude.codes import Notice
from etude.errors import UsageError
from etude.models.change.change_detection import FREEDOM
from etude.models.data.as_log import Run, as_log, as_run
from etude.models.process_abilities import HasInputs, SupportsBound, name_of, share_of
from etude.models.selection.linear import at_rest
from etude.models.selection.member_prediction import (
    Means,
    fallback_physics,
    level_of,
    noise_of,
    outputs,
    rests_of,
)
from etude.models.student_t import StudentT
from etude.models.trust import known_in_training, outside, thresholds, trusted
from etude.progress import counted
from etude.protocols import Candidate, Inputs, Mean, Posterior, Process, Trajectory
from etude.threads import threads_for
from etude.types import Array, Channel, Column, Log, Mask

_InUse = tuple[Candidate, list[int]]
_Each = Callable[[list[_InUse]], Iterable[_InUse]]
_Ask = Callable[[Process, Array], tuple[Array, Array]]


def _predict(process: Process, X: Array) -> tuple[Array, Array]:
    return process.predict(X)


def _at_most(process: Process, X: Array) -> tuple[Array, Array]:
    return process.at_most(X) if isinstance(process, SupportsBound) else process.predict(X)


MOST_INPUTS = 64
"""Largest number of inputs, evenly spread: a mean variance over them is accurate to a tenth."""


def known_of(candidates: Sequence[Candidate], believed: Sequence[bool]) -> Array:
    """(J,) what may be unknown of each command before a row lies outside; infinite where no process has
    inputs, and 0 where the mean is not believed: it is known nowhere.
    """
    levels = np.full(len(believed), np.inf)
    for j in range(len(believed)):
        members = [(c, c.commands.index(j)) for c in candidates if j in c.commands]
        members = [(c, place) for c, place in members if c.weights[place] > 0.0]
        X = _inputs(members)
        if X is not None:
            levels[j] = _known_of_command(members, X) if believed[j] else 0.0
    return levels


def _inputs(members: list[tuple[Candidate, int]]) -> Array | None:
    """(k, D) of the candidate that weighs most among those that have some."""
    for candidate, _ in sorted(members, key=lambda pair: -float(pair[0].weights[pair[1]])):
        process: object = candidate.process
        X = process.conditioned_on if isinstance(process, HasInputs) else None
        if X is not None and len(X):
            return np.asarray(X[:: -(-len(X) // MOST_INPUTS)])
    return None


def _known_of_command(members: list[tuple[Candidate, int]], X: Array) -> float:
    """Of one command. Candidates that stand on one mean function are told apart by their outputs; how far
    mean functions are apart is not known of inputs alone, and not counted."""
    weights = np.array([float(c.weights[place]) for c, place in members])
    means, unknown, noise = [], [], 0.0
    for weight, (candidate, place) in zip(weights, members, strict=True):
        assert candidate.process is not None
        factor = float(candidate.calibration[place] * candidate.units[1, place] ** 2)
        white = float(candidate.process.noise_variance[place])
        latent = candidate.process.predict(X)[1][:, place]
        held = noise_of(candidate, X)[:, place] - factor * white
        unknown.append(factor * latent - held)
        means.append(candidate.units[0, place] + outputs(candidate, X)[:, place])
        noise += weight * factor * white
    apart = np.zeros(len(X))
    for mean in {id(candidate.mean) for candidate, _ in members}:
        alike = [k for k, (candidate, _) in enumerate(members) if id(candidate.mean) == mean]
        outputs_, part_weights = np.stack([means[k] for k in alike]), weights[alike]
        average = part_weights @ outputs_ / part_weights.sum()
        apart = apart + part_weights @ (outputs_ - average) ** 2
    return float(
        known_in_training(np.asarray(np.mean(weights @ np.stack(unknown) + apart)), np.asarray(noise))
    )


def leading_structures(candidates: Sequence[Candidate], commands: int) -> tuple[str, ...]:
    """The structure with most weight in each of that many commands, the first of equal ones; "" of none."""
    weights: list[dict[str, float]] = [{} for _ in range(commands)]
    for candidate in candidates:
        for j, weight in zip(candidate.commands, candidate.weights.tolist(), strict=True):
            if weight > 0.0:
                weights[j][candidate.structure] = weights[j].get(candidate.structure, 0.0) + weight
    return tuple(
        max(by_structure, key=lambda name: by_structure[name], default="") for by_structure in weights
    )


class Prediction(tuple[Array, Array]):
    """(mean, variance), each (n, J): `mean, variance = model.predict(log)`.

    Attributes:
        unknown: (n, J) the variance without noise, at rest too, before it is widened.
        notes: sentences about what the answer holds for, such as that rows counted by themselves.
    """

    unknown: Array
    notes: tuple[str, ...]

    @classmethod
    def of(cls, mean: Array, variance: Array, unknown: Array, notes: Sequence[str] = ()) -> Prediction:
        """The pair with what is beside it."""
        prediction = cls((mean, variance))
        prediction.unknown, prediction.notes = unknown, tuple(notes)
        return prediction

    @property
    def mean(self) -> Array:
        return self[0]

    @property
    def variance(self) -> Array:
        return self[1]


@dataclass(frozen=True, eq=False, repr=False)
class LearnedModel:
    """What was learned (implements `protocols.Model`).

    Attributes:
        inputs: of all processes, with the facts identified from the samples.
        candidates: every structure that was trained, group by group, the default's first; for commands that a
            structure was chosen for the weights of its candidates add up to 1, and are 0 elsewhere. Those of
            physics and linear regression alone have a process too, which says nothing but where the robot
            has not been.
        commands: names of the J commands.
        ranges: (2, D) least and largest of each input trained on.
        calibrated: whether enough trajectories were held out for the variances to be believed.
        independence: (J,) see `worth`.
        different: share of the commands whose held-out errors are different ones, `different_outputs`.
        freedom: degrees of freedom of Student's t, the tails of held-out errors over predicted deviations.
        member: name of the processes' member, to restore them by.
        width: (J,) factor on all variances that are told, as logs left out ask for (`selection.width`); what
            is unknown is not widened, since trust compares it with what was to be learned. None: 1.
        least: (J,) variance that is claimed anywhere at least, where motion was too short; None: none.
        student: distribution of held-out errors over predicted deviations, or None.
        warnings: of commands that linear regression predicts better, or that moved too little.
    """

    inputs: Inputs
    candidates: tuple[Candidate, ...]
    commands: tuple[str, ...]
    ranges: Array
    calibrated: bool
    independence: Array
    freedom: float = FREEDOM
    different: float = 1.0
    member: str = "exact"
    least: Array | None = None
    width: Array | None = None
    student: StudentT | None = None
    warnings: tuple[Notice, ...] = ()

    @property
    def structures(self) -> tuple[str, ...]:
        """Names of the structures that were trained, each once."""
        return tuple(dict.fromkeys(candidate.structure for candidate in self.candidates))

    @property
    def chosen(self) -> tuple[str, ...]:
        """The structure of each command, of several that with most weight."""
        return leading_structures(self.candidates, len(self.commands))

    @property
    def in_use(self) -> tuple[str, ...]:
        """The structures that any command is made of."""
        return tuple(dict.fromkeys(candidate.structure for candidate, _ in self._in_use()))

    def of_structure(self, structure: str) -> LearnedModel:
        """The same model with one structure for all commands.

        Raises:
            UsageError: the structure was not trained for all commands.
        """
        members = tuple(
            replace(c, weights=share_of(c) * float(c.structure == structure)) for c in self.candidates
        )
        if not self._covers(structure):
            raise UsageError(
                f"the model has no structure {structure!r} for every command",
                next_step=f"It has {', '.join(self.structures)}.",
            )
        alone = self.in_use == (structure,)
        return replace(self, candidates=members, width=self.width if alone else None, warnings=())

    def _covers(self, structure: str) -> bool:
        commands = {j for c in self.candidates if c.structure == structure for j in c.commands}
        return len(commands) == len(self.commands)

    def of_command(self, command: int) -> LearnedModel:
        """The same model for who asks one command alone: what only serves others is not in use, and no price
        is paid for it.
        """
        masks = (np.array([float(j == command) for j in c.commands]) for c in self.candidates)
        pairs = zip(self.candidates, masks, strict=True)
        return replace(self, candidates=tuple(replace(c, weights=c.weights * keep) for c, keep in pairs))

    @property
    def columns(self) -> tuple[Column, ...]:
        """What is looked at: by the inputs, and beside them by the means in use."""
        means = [m for m in (*(c.mean for c, _ in self._in_use()), *self._fallbacks) if m is not None]
        beside = (column for mean in means if isinstance(mean, SupportsColumns) for column in mean.columns)
        return tuple(dict.fromkeys([*self.inputs.columns, *beside]))

    @property
    def prior_deviation(self) -> Array:
        """(J,) deviation of what the candidates in use explain, before any data, command units; with noise,
        that of joints at rest among it.
        """
        return self._prior(noise=True)

    @property
    def signal_deviation(self) -> Array:
        """(J,) the same without noise, of which nothing can be learned."""
        return self._prior(noise=False)

    def _prior(self, *, noise: bool) -> Array:
        variance = np.zeros(len(self.commands))
        for candidate, columns in self._in_use():
            assert candidate.process is not None
            prior = candidate.process.signal_variance
            if noise:
                held = [sum(s for _, s in pairs) for pairs in rests_of(candidate)]
                prior = prior + candidate.process.noise_variance + held
            variance[columns] += candidate.weights * candidate.units[1] ** 2 * prior
        return np.asarray(np.sqrt(variance))

    def latents(self) -> Sequence[tuple[Posterior, tuple[int, ...]]]:
        """What a design sees: a posterior for each command, the default's of the structure in use."""
        latents, chosen = [], self.chosen
        for candidate in self.candidates:
            if candidate.process is None or name_of(candidate) != "default":
                continue
            for posterior, places in candidate.process.latents():
                commands = [candidate.commands[p] for p in places]
                used = tuple(j for j in commands if chosen[j] == candidate.structure)
                latents += [(posterior, used)] if used else []
        return latents

    def worth(self) -> Array:
        """(J,) independent samples that a sample is worth."""
        return self.independence

    def __repr__(self) -> str:
        structures = ", ".join(
            f"{name}: {structure}" for name, structure in zip(self.commands, self.chosen, strict=True)
        )
        state = "calibrated" if self.calibrated else "not calibrated yet"
        return f"LearnedModel of {len(self.commands)} commands, {state} ({structures})"

    def predict(self, log: Any, *, fade: bool = True) -> Prediction:
        """What to command (n, J), and its variance (n, J), which includes noise and calibration.

        The mean of `posterior` where the model knows more than before any data. Elsewhere it fades to `safe`
        by its own deviation: to physics where they are used, else to a level. Every export says the same.

        Args:
            log: a Log, arrays (n, parts) by channel, or a data frame; see `given.as_run`. Its rows are a
                run, in order: friction remembers the way. Arrays without times count row by row.
            fade: False gives the mean of `posterior` everywhere.

        Returns:
            a pair that also says what holds of it, as `Prediction.notes`.
        """
        run = as_run(log, self.columns, self.inputs)
        return self._prediction(run, iter, fade=fade)

    def faded(self, log: Any) -> Array:
        """The commands (n, J) of `predict` alone, to rounding, for less.

        Variances cost most, and only decide how far a command fades. Where an upper bound of what is unknown
        leaves full trust, nothing fades; processes predict again only at the other rows of their commands.
        """
        means = Means(as_run(log, self.columns, self.inputs).log)
        X, in_use = self.inputs.of_log(means.log), self._in_use()
        processes = {id(c.process): c.process for c, _ in in_use if c.process is not None}
        predictions = {key: _at_most(process, X) for key, process in processes.items()}

        def made(process: Process, X: Array) -> tuple[Array, Array]:  # noqa: ARG001
            return predictions[id(process)]

        average, variance, noise = self._predicted(means, iter, made, X)
        full, _ = thresholds(self.signal_deviation, self.known)
        doubtful = ~(variance - noise <= full)  # what is no number too
        if not doubtful.any():
            return average
        for key, process in processes.items():
            served = [doubtful[:, columns].any(axis=1) for c, columns in in_use if c.process is process]
            rows = np.logical_or.reduce(served)
            if rows.any():
                predictions[key][1][rows] = process.predict(X[rows])[1]
        average, variance, noise = self._predicted(means, iter, made, X)
        return self._faded(average, variance - noise, means)

    def at_most(self, log: Any) -> tuple[Array, Array]:
        """As `predict`, with variances that are never below its own: for less, where processes know how."""
        average, variance, _ = self._predicted(Means(as_log(log, self.columns)), iter, _at_most)
        return average, self.widened(variance)

    def widened(self, variance: Array) -> Array:
        """Variances (n, J) with the model's width."""
        return variance if self.width is None else np.asarray(variance * self.width)

    def posterior(self, log: Any) -> tuple[Array, Array]:
        """Mean and variance (n, J) of the commands given the data, nothing faded: what learning, scores and
        designs ask.

        States as for `predict`, of a Log as they are: what friction remembers counts where the log carries
        it.
        """
        average, variance, _ = self.parted(log)
        return average, variance

    def posteriors(self, log: Log) -> dict[str, tuple[Array, Array]]:
        """As `posterior`, by structure that was trained for all commands, and under "" of those in use; each
        process predicts once.
        """
        means, predictions = Means(log), dict[int, tuple[Array, Array]]()

        def memoized(process: Process, X: Array) -> tuple[Array, Array]:
            if id(process) not in predictions:
                predictions[id(process)] = process.predict(X)
            return predictions[id(process)]

        models = {"": self} | {s: self.of_structure(s) for s in self.structures if self._covers(s)}
        results = {name: model._predicted(means, iter, memoized) for name, model in models.items()}
        return {name: (mean, models[name].widened(variance)) for name, (mean, variance, _) in results.items()}

    def parted(self, log: Any) -> tuple[Array, Array, Array]:
        """As `posterior`, and the part (n, J) of the variance that is noise, at rest too."""
        log = log if isinstance(log, Log) else as_run(log, self.columns, self.inputs).log
        average, variance, noise = self._predicted(Means(log), iter)
        return average, self.widened(variance), self.widened(noise)

    def unknown(self, log: Any) -> Array:
        """(n, J) what is unknown of each command: the variance of `posterior` without noise, at rest too."""
        run = as_run(log, self.columns, self.inputs)
        _, variance, noise = self._predicted(Means(run.log), iter)
        return np.asarray(variance - noise)

    def outside(self, log: Any) -> Mask:
        """(n, J) where a row lies outside of what a command was learned from: its deviation is more than
        twice that of training (`trust.outside`).
        """
        return outside(self.unknown(log), self.known)

    @cached_property
    def known(self) -> Array:
        """(J,) what may be unknown of each before a row lies outside; infinite where nothing tells."""
        doubted = np.zeros(len(self.commands)) if self.least is None else self.least
        return known_of(self.candidates, (doubted <= 0.0).tolist())

    def _prediction(self, run: Run, each: _Each, *, fade: bool = True) -> Prediction:
        means = Means(run.log)
        average, variance, noise = self._predicted(means, each)
        command, unknown = average, variance - noise
        if fade:
            command = self._faded(average, unknown, means)
        return Prediction.of(command, self.widened(variance), unknown, run.notes)

    def _faded(self, average: Array, unknown: Array, means: Means) -> Array:
        return trusted(average, unknown, self.signal_deviation, self._safe(means), self.known)

    @threads_for(0)  # products are as narrow as the inputs; large ones inside ask for more threads
    def _predicted(
        self, means: Means, each: _Each, ask: _Ask = _predict, X: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Mean and variance (n, J), and the part of the variance that is noise, at rest too; `each` goes
        through the candidates. ask: their processes' means and variances. X (n, D): inputs of the processes,
        if not those of the log.
        """
        X, parts = self.inputs.of_log(means.log) if X is None else X, []
        average = np.zeros((len(X), len(self.commands)))
        for candidate, columns in each(self._in_use()):
            assert candidate.process is not None
            output, latent = ask(candidate.process, X)
            mean = means.of(candidate) + candidate.units[1] * output
            noisy = latent + candidate.process.noise_variance
            average[:, columns] += candidate.weights * mean
            parts.append((columns, candidate, mean, candidate.calibration * candidate.units[1] ** 2 * noisy))
        variance, noise = np.zeros_like(average), np.zeros_like(average)
        for columns, candidate, mean, spread in parts:
            variance[:, columns] += candidate.weights * (spread + (mean - average[:, columns]) ** 2)
            noise[:, columns] += candidate.weights * noise_of(candidate, X)
        if self.least is not None:  # a mean that is not believed may be wrong by all of itself
            doubted = self.least > 0.0
            variance = np.where(doubted, np.maximum(variance, self.least + average**2), variance)
            noise = np.where(doubted, 0.0, noise)
        return average, variance, noise

    def mean(self, log: Log) -> Array:
        """Commands (n, J) alone, without the price of their variances."""
        X, means = self.inputs.of_log(log), Means(log)
        return self._weighted(len(log), [means.of(c) + outputs(c, X) for c, _ in self._in_use()])

    def commanded(self, log: Log) -> Log:
        """Channels "command", "deviation" and "outside", (n, J), at each row of a log of states: `predict`,
        the root of its variance, and 1 where the row lies outside of what was learned, else 0. Says how far
        it is.
        """
        prediction = self._prediction(as_run(log, self.columns, self.inputs), counted)
        parts = Channel("command", self.commands, ("",) * len(self.commands), "command")
        beside = {name: replace(parts, name=name, role="aside") for name in ("deviation", "outside")}
        values = {"command": prediction.mean, "deviation": np.sqrt(prediction.variance)}
        values["outside"] = outside(prediction.unknown, self.known).astype(float)
        return replace(log, channels={parts.name: parts, **beside}, values=values)

    def feedforward(self, trajectory: Trajectory, rate: float = 100.0) -> Log:
        """Commands with deviations along a perfect run of a trajectory, `rate` times a second, its end too.

        Channels "command" and "deviation", (T, J); the deviation is that of one sample as it is learned, at
        the model's own rate, whatever `rate` is. Take a rate at which the inputs' memory sees where the
        motion turns (`inputs.rate`).
        """
        return self.commanded(self.planned(trajectory, rate))

    def planned(self, trajectory: Trajectory, rate: float) -> Log:
        """The states of a perfect run at those times."""
        t = np.minimum(np.arange(int(np.ceil(trajectory.duration * rate)) + 1) / rate, trajectory.duration)
        return self.inputs.states(trajectory.motion(t, self.inputs.orders))

    def static(self, log: Any, *, fade: bool = True) -> Array:
        """The part (n, J) of the commands that remains at rest; states and `fade` as for `predict`."""
        log = as_log(log, self.columns)
        X, means = self.inputs.of_log(at_rest(log)), Means(log, static=True)
        held = [i for i, column in enumerate(self.inputs.columns) if column[3] == "memory"]
        X[:, held] = 0.0  # what friction holds at rest is no gravity
        if not fade:
            return self._weighted(len(log), [means.of(c) + outputs(c, X) for c, _ in self._in_use()])
        average, variance, noise = self._predicted(means, iter, X=X)
        return self._faded(average, variance - noise, means)

    def gravity(self, q: Any) -> Array:
        """The same (n, J) in poses q (n, J), rad or m; with or without physics, of every structure.

        Raises:
            UsageError: q has another shape, or the inputs hold no position for each command.
        """
        columns, q = self.inputs.columns, np.asarray(q, dtype=float)
        widths = Counter(channel for channel, _, _, op in columns if not op)
        position = columns[0][0]
        if tuple(part for channel, part, _, op in columns if channel == position and not op) != self.commands:
            raise UsageError(
                f"{position}, the first input, is not one position per command",
                next_step="Use static(log), with a log of the states.",
            )
        if q.ndim != 2 or q.shape[1] != widths[position]:
            raise UsageError(f"poses have shape {q.shape}, not (n, {widths[position]})")
        still = {channel: np.zeros((len(q), width)) for channel, width in widths.items()}
        return self.static({**still, position: q})

    def safe(self, log: Log) -> Array:
        """Commands (n, J) that a feedforward may fade to: of physics, where there are any
        (`behind`), else `level_of`.
        """
        return self._safe(Means(log))

    def behind(self, candidate: Candidate) -> Mean | None:
        """The physics that a candidate's commands fade to; None: `level_of`."""
        doubted = self.least is not None and bool((self.least[list(candidate.commands)] > 0.0).any())
        return fallback_physics(candidate, self.candidates, not doubted)

    @cached_property
    def _fallbacks(self) -> tuple[Mean | None, ...]:
        """Fallback physics of each candidate in use; every tick reads them."""
        return tuple(self.behind(candidate) for candidate, _ in self._in_use())

    def _safe(self, means: Means) -> Array:
        parts = []
        for (candidate, columns), behind in zip(self._in_use(), self._fallbacks, strict=True):
            parts.append(level_of(candidate)[None] if behind is None else means.alone(behind, columns))
        return self._weighted(len(means.log), parts)

    def _weighted(self, count: int, parts: Sequence[Array]) -> Array:
        out = np.zeros((count, len(self.commands)))
        for (candidate, columns), part in zip(self._in_use(), parts, strict=True):
            out[:, columns] += candidate.weights * part
        return out

    def _in_use(self) -> list[_InUse]:
        return [(c, list(c.commands)) for c in self.candidates if c.weights.any()]
