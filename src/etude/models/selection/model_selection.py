"""Model selection: all structures that a robot allows, and for each command the best on new motion.

A structure is a mean function (none, linear regression, identified or nominal physics), with a process on
what it leaves or without. A process can be worse than linear regression. Outside the data it returns to its
mean, where a linear trend goes on. It can diverge where too few samples taught its hyperparameters. So
linear regression is a structure like the others.

Physics are fitted without the segment and the process is conditioned without it. The few hyperparameters of
the process, and which structure is used, were chosen with all segments.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from etude.abilities import SupportsRipple, SupportsSlow
from etude.codes import stated
from etude.errors import DataError, UsageError
from etude.models.accuracy import PredictionScore, figures, prediction_score, trivial_prediction
from etude.models.change.change_detection import different_outputs, independence, student_freedom
from etude.models.config import ModelConfig
from etude.models.data.cross_validation import Base, HeldOut, fitted_base, fold_mean, fold_numbers
from etude.models.data.fit_data import Folds, Rows, in_order, rows_of, scored_samples
from etude.models.learned_model import LearnedModel
from etude.models.process_abilities import EnsembleMember
from etude.models.selection.candidate_errors import CandidateErrors
from etude.models.selection.ensemble import (
    CANDIDATES,
    Average,
    Sources,
    averages,
    beside_default,
    candidate_errors,
    compared_samples,
)
from etude.models.selection.linear import LinearPhysics
from etude.models.selection.noise_floor import with_process
from etude.models.selection.selection_rule import TRAJECTORIES, choices, least_variance, notes, warnings_of
from etude.models.selection.stacking import left_out, stacks
from etude.models.selection.structures import (
    LearnedStructure,
    alone,
    base_of,
    earlier_of,
    rows_only,
)
from etude.models.selection.width import LEAST_LOGS, widths
from etude.models.student_t import StudentT, fit_student
from etude.progress import counted, part
from etude.protocols import Inputs, Physics
from etude.storage import DAMAGE, arrays_of
from etude.types import Array, Index, Mask, Samples

OFFERED = ("gp", "identified+gp", "identified", "nominal", "linear", "linear+gp")
"""Structures of rung = "auto", as far as there are physics for them; of equal ones the first counts."""
LEAST_CALIBRATED = 4
"""Trajectories from which z² of those held out tells how wrong a new one will be; widths hold from
`LEAST_LOGS` on."""
OWN_DATA = tuple(name for name, member in CANDIDATES.items() if member.own_data)
"""Candidates with samples and physics of their own, where these may be so."""
STRUCTURES = 0.3
"""About the part of the time that the structures take; the rest is that of the candidates beside them."""


@dataclass(frozen=True, eq=False)
class ModelSelection:
    """All trained structures and the choice among them.

    Attributes:
        model: with every structure, weighted by the choice.
        errors: by structure, (J,) held-out error that decided; "linear" is there even if it was not offered.
        held_out: by structure, what it says of each sample without having seen its trajectory, its variances
            calibrated.
        scores: by structure, of the same.
        left_out: of the choice, the same as `held_out`.
        samples: those that it is of, in their order. score_target: (n, J) commands that errors are of.
    """

    model: LearnedModel
    errors: dict[str, Array]
    held_out: dict[str, HeldOut]
    scores: dict[str, PredictionScore]
    left_out: HeldOut
    samples: Samples
    score_target: Array

    @property
    def chosen(self) -> tuple[str, ...]:
        """The structure of each command."""
        return self.model.chosen


def select_structures(
    samples: Samples,
    inputs: Inputs,
    physics: Mapping[str, Physics],
    limit: Array,
    config: ModelConfig,
    rng: np.random.Generator,
    previous: LearnedModel | None = None,
    held: Mask | None = None,
) -> ModelSelection:
    """Trains every structure that `config` and the robot allow, and chooses for each command.

    Args:
        samples: of one or more trajectories, in any order.
        inputs: the robot's; what the samples tell of them is set first.
        physics: of the robot, by structure: "identified", "nominal". "linear" may be overridden.
        limit: (J,) of the commands, the scale of a noise floor.
        rng: draws the offsets of the thinning.
        previous: an earlier model; training goes on from its structures, as `config.schedule` says.
        held: (J,) commands of coordinates that no log has moved, which are not believed; None: none.

    Raises:
        UsageError: a structure without its physics, a plug-in that does not work, limits of another robot.
        DataError: no sample, an input that the samples lack, or an axis that never moved.
    """
    folds = _folds(samples, inputs, limit, config, held)
    offered = _offered(config, physics)
    all_physics = {"linear": LinearPhysics(folds.inputs), **physics}
    names = dict.fromkeys(["linear", *(base_of(structure) for structure in offered)])
    bases = {name: fitted_base(folds, name, all_physics[name]) for name in names if name}
    sources = _sources(folds, all_physics)
    defaults, groups = _of_defaults(folds, sources), []
    with part(STRUCTURES):
        for group in counted(folds.groups):
            rows = rows_of(defaults, group, rng)
            groups.append(_train_group(defaults, group, rows, offered, bases, rng, previous))
    with part(1.0 - STRUCTURES):
        more, broken = beside_default(folds, groups, bases, sources, rng, previous)
    every = candidate_errors(folds, groups, more) if more or config.stacks else []
    selection = _assembled(folds, groups, every, bases["linear"])
    off = stated([f"The candidate {name} is not used: {why}" for name, why in broken.items()])
    return replace(selection, model=replace(selection.model, warnings=(*off, *selection.model.warnings)))


def prequential(
    model: LearnedModel, new: Samples, trained: Samples | None = None, together: str = ""
) -> dict[str, PredictionScore]:
    """Score of each structure of an earlier model on motion that it was not trained on.

    Args:
        trained: its training samples, for the log loss.
        together: name of one more score where several structures are in use: of these; "": none.
    """
    predictions = model.posteriors(new.log)
    mixed = predictions.pop("")
    if together and len(model.in_use) > 1:
        predictions[together] = mixed
    return {name: prediction_score(new, *moments, trained) for name, moments in predictions.items()}


def _folds(
    samples: Samples, inputs: Inputs, limit: Array, config: ModelConfig, held: Mask | None = None
) -> Folds:
    if not len(samples):
        raise DataError("there is no sample to learn from", next_step="Ingest a log first.")
    samples = in_order(samples)
    commands = samples.log.channels["command"].parts
    limit = np.asarray(limit, dtype=float)
    if limit.shape != (len(commands),) or not bool(np.all(limit > 0.0)):
        raise UsageError(
            f"the samples have {len(commands)} commands, the robot's limits are {limit.tolist()}",
            next_step="Use the robot that the logs were recorded with.",
        )
    if not np.isfinite(samples.command[samples.usable]).all():
        raise DataError("training data contain NaN or infinite values", next_step="Repair the log first.")
    inputs = inputs.fitted(samples)
    try:
        X = np.asarray(inputs.of_log(samples.log), dtype=float)
    except KeyError as error:
        raise DataError(
            f"the samples lack an input ({error.args[0]})", next_step="Disable that input, or log it."
        ) from error
    if X.shape != (len(samples), len(inputs.columns)) or not np.isfinite(X).all():
        raise DataError(
            f"the inputs of {len(samples)} samples are not numbers, or have shape {X.shape}",
            next_step="Repair the log, or disable the missing input.",
        )
    fold = fold_numbers(samples, config.stretch_s)
    scored = scored_samples(samples) if config.stacks else None
    config = config.for_commands(len(commands))
    return Folds(samples, inputs, X, fold, limit, config, commands, held, scored)


def _sources(folds: Folds, physics: Mapping[str, Physics]) -> Sources:
    """Candidates with samples and physics of their own, as far as these may be so: what slow samples tell,
    and what returns with a joint's position.
    """
    identified: object = physics.get("identified")
    config, data = folds.config, dict[str, tuple[Samples, Physics]]()
    if not (config.stacks and config.averages):
        return {}
    names = [name for name in config.candidates if name in OWN_DATA and CANDIDATES[name].offered(folds, ())]
    if (
        "slow" in names
        and isinstance(identified, SupportsSlow)
        and (slow := identified.slow(folds.samples)) is not None
    ):
        data["slow"] = slow, physics["identified"]
    if (
        "ripple" in names
        and isinstance(identified, SupportsRipple)
        and (rippled := identified.rippled(folds.samples))
    ):
        data["ripple"] = rippled
    sources = {}
    for name, (samples, one) in data.items():
        source = replace(folds, samples=samples)
        sources[name] = source, fitted_base(source, "identified", one)
    return sources


def _of_defaults(folds: Folds, sources: Sources) -> Folds:
    """What the default's processes learn from: where others have samples and physics of their own, and there
    is a log to leave out, `points` alone.

    Beside those others, all samples through inducing inputs took half the time of a training and had nearly
    no weight (docs/decisions/0061-stacking.md).
    """
    if not sources or folds.trajectories < LEAST_LOGS:
        return folds
    return replace(folds, config=replace(folds.config, inducing=0))


def _offered(config: ModelConfig, physics: Mapping[str, Physics]) -> list[str]:
    """The structures to train; those of one name alone bring the process that designs see."""
    there = ("", "linear", *physics)
    possible = [structure for structure in OFFERED if base_of(structure) in there]
    if config.rung == "auto":
        return possible
    if base_of(config.rung) not in there:
        raise UsageError(
            f"there are no {base_of(config.rung)} physics of this robot",
            where=f"model.rung = {config.rung!r}",
            next_step=f"Describe the robot's body, or use one of {', '.join(possible)}.",
        )
    return [config.rung]


def _train_group(
    folds: Folds,
    group: tuple[int, ...],
    rows: Rows,
    offered: Sequence[str],
    bases: Mapping[str, Base],
    rng: np.random.Generator,
    previous: LearnedModel | None,
) -> dict[str, LearnedStructure]:
    """Every structure of a group, the first the one that is taken if nothing was held out."""
    auto = folds.config.rung == "auto"
    trained: dict[str, LearnedStructure] = {}

    def process(structure: str) -> LearnedStructure:
        base = bases.get(base_of(structure))
        start = earlier_of(previous, structure, group, folds)
        single = len(group) == 1 and len(folds.numbers) > 1
        compared = compared_samples(folds, group[0]) if single and folds.config.weighs else None
        return with_process(folds, group, rows, structure, base, start, rng, compared)

    late = ["linear+gp"] if auto else []
    for structure in [
        structure for structure in offered if structure.endswith("gp") and structure not in late
    ]:
        trained[structure] = process(structure)
    if auto and _loses(folds, group, rows, trained, bases):
        trained["linear+gp"] = process("linear+gp")
    for structure in [structure for structure in offered if not structure.endswith("gp")]:
        twins = (f"{structure}+gp", *(() if structure == "linear" else ("identified+gp",)), "gp")
        twin = next((twin for twin in twins if twin in trained), None)
        if twin is None:
            twin = f"{structure}+gp"
            trained[twin] = process(twin)
        trained[structure] = alone(folds, group, rows, structure, bases[structure], trained[twin].candidate)
    order = [structure for structure in (*offered, *trained) if structure in trained]
    return {structure: trained[structure] for structure in dict.fromkeys(order)}


def _loses(
    folds: Folds,
    group: tuple[int, ...],
    rows: Rows,
    trained: Mapping[str, LearnedStructure],
    bases: Mapping[str, Base],
) -> bool:
    """Whether linear regression predicts a command of the group better than everything else."""
    if folds.trajectories < TRAJECTORIES:
        return False
    held = {structure: learned.held for structure, learned in trained.items()}
    for name, base in bases.items():
        held[name] = rows_only(base.held_out(folds), group, rows)
    errors = {structure: held_out.errors(folds.config.choose_by) for structure, held_out in held.items()}
    best = np.fmin.reduce([error for name, error in errors.items() if name != "linear"])
    return bool(np.any(errors["linear"] < best))


def _assembled(
    folds: Folds,
    groups: Sequence[Mapping[str, LearnedStructure]],
    every: Sequence[CandidateErrors],
    linear: Base,
) -> ModelSelection:
    """The model of all groups, its candidates weighed for each command.

    every: all candidates, the defaults of the groups first; none where these are all and one is chosen.
    """
    defaults = [learned for group in groups for learned in group.values()]
    averaged = averages(folds, every, len(defaults)) if every else {}
    held = _held_of_structures(folds, defaults, every, averaged, linear)
    pairs = list(zip(folds.groups, groups, strict=True))
    trained = [list(learned) for j in range(len(folds.commands)) for group, learned in pairs if j in group]
    chosen = choices(folds, trained, held)
    mixture = _mixture(folds, defaults, every, averaged, held, chosen)
    single = {j: name for j, name in enumerate(chosen) if j not in mixture.stacked}
    least = least_variance(folds, mixture.candidates)
    width = _width(folds, mixture, least)
    spread = mixture.variance * width
    warnings = (*notes(folds), *warnings_of(folds, trained, single, held))
    fitted = _model(folds, mixture.candidates, mixture.error, spread)
    model = replace(fitted, least=least, width=width, warnings=warnings)
    errors = {name: one.errors(folds.config.choose_by) for name, one in held.items()}
    trivial = trivial_prediction(folds.samples)
    scores = {name: _score(folds, one, trivial) for name, one in held.items()}
    of_choice = HeldOut(mixture.error, spread, folds.fold)
    return ModelSelection(model, errors, held, scores, of_choice, folds.samples, folds.score_target)


def _held_of_structures(
    folds: Folds,
    defaults: Sequence[LearnedStructure],
    every: Sequence[CandidateErrors],
    averaged: Mapping[str, Average],
    linear: Base,
) -> dict[str, HeldOut]:
    """By structure, for all commands; linear regression too if it was not offered."""
    errors = (
        every[: len(defaults)]
        if folds.config.stacks
        else [CandidateErrors.of(learned) for learned in defaults]
    )
    held = _joined(folds, errors) | {structure: average.held for structure, average in averaged.items()}
    held.setdefault(
        "linear", linear.errors_at(folds, folds.score_target, folds.error_mask).at(_scored_rows(held))
    )
    return held


def _scored_rows(held: Mapping[str, HeldOut]) -> Mask:
    """(n, J) where some structure was scored."""
    return np.asarray(np.any([np.isfinite(held_out.error) for held_out in held.values()], axis=0))


@dataclass(frozen=True, eq=False)
class _Mixture:
    """The candidates that a model keeps, and what their weighted mean says of held-out samples.

    Attributes:
        candidates: with their weights. error, variance: (n, J); NaN where nothing was scored.
        stacked: commands whose weights are those of stacking; the others use the chosen structure.
    """

    candidates: tuple[EnsembleMember, ...]
    error: Array
    variance: Array
    stacked: frozenset[int]


def _mixture(
    folds: Folds,
    defaults: Sequence[LearnedStructure],
    every: Sequence[CandidateErrors],
    averaged: Mapping[str, Average],
    held: Mapping[str, HeldOut],
    chosen: Sequence[str],
) -> _Mixture:
    """Stacked where candidates are stacked, else the chosen structure of each command."""
    error = np.column_stack([held[structure].error[:, j] for j, structure in enumerate(chosen)])
    variance = np.column_stack([held[structure].variance[:, j] for j, structure in enumerate(chosen)])
    parts = [one.part for one in every] or defaults
    shares = _shares(parts, averaged.values(), len(chosen))
    weights = shares * [[float(part.candidate.structure == name) for name in chosen] for part in parts]
    scored, stacked = _scored_rows(held), stacks(folds, every)
    for j, stack in stacked.items():
        weights[:, j] = stack.weights
        predicted = left_out(stack, every, j, folds.fold)
        error[:, j], variance[:, j] = (np.where(scored[:, j], values, np.nan) for values in predicted)
    used = [k for k in range(len(parts)) if k < len(defaults) or weights[k].any() or shares[k].any()]
    candidates = tuple(_weighed(parts[k].candidate, shares[k], weights[k]) for k in used)
    return _Mixture(candidates, error, variance, frozenset(stacked))


def _width(folds: Folds, mixture: _Mixture, least: Array | None) -> Array:
    """(J,) factors on variances; 1 where a least variance is stated already, or nothing is calibrated."""
    count = mixture.error.shape[1]
    if not (folds.config.calibrate and folds.config.stacks):
        return np.ones(count)
    doubted = np.zeros(count, dtype=np.bool_) if least is None else least > 0.0
    factors = widths(mixture.error, mixture.variance, folds.fold, folds.trajectories)
    return np.where(doubted, 1.0, factors)


def _model(
    folds: Folds, candidates: tuple[EnsembleMember, ...], error: Array, variance: Array
) -> LearnedModel:
    """The model of these candidates; tails and independence are those of held-out errors."""
    config, samples = folds.config, folds.samples
    use = samples.usable & samples.moving
    z = np.where(use, (error - (folds.score_target - samples.command)) / np.sqrt(variance), np.nan)
    freedom = student_freedom(z)
    enough = LEAST_LOGS if config.stacks else LEAST_CALIBRATED
    return LearnedModel(
        inputs=folds.inputs,
        candidates=candidates,
        commands=folds.commands,
        ranges=np.stack([folds.X.min(axis=0), folds.X.max(axis=0)]),
        calibrated=config.calibrate and folds.trajectories >= enough,
        independence=independence(z, freedom, samples.t, samples.group, use),
        freedom=freedom,
        different=different_outputs(z, freedom),
        member=config.process,
        student=_student(error, variance) if config.student_t else None,
    )


def _shares(parts: Sequence[LearnedStructure], averaged: Collection[Average], J: int) -> Array:
    """(K, J) weights of candidates within their structures; 1 of one that is alone in it."""
    share_by_id = {
        id(learned): share for one in averaged for learned, share in zip(one.parts, one.shares, strict=True)
    }
    several = {learned.candidate.structure for one in averaged for learned in one.parts}
    weights = np.zeros((len(parts), J))
    for row, learned in zip(weights, parts, strict=True):
        single = float(learned.candidate.structure not in several)
        row[list(learned.candidate.commands)] = share_by_id.get(id(learned), single)
    return weights


def _weighed(candidate: EnsembleMember, share: Array, weight: Array) -> EnsembleMember:
    """With its weights in the answer and within its structure, each (J,)."""
    outputs = list(candidate.commands)
    return replace(candidate, weights=weight[outputs], share=share[outputs])


def _joined(folds: Folds, errors: Sequence[CandidateErrors]) -> dict[str, HeldOut]:
    """By structure, what its default candidates say of all commands; NaN where it was not trained."""
    held: dict[str, HeldOut] = {}
    for one in errors:
        candidate = one.part.candidate
        error, variance = (np.full_like(folds.samples.command, np.nan) for _ in range(2))
        held_out = held.setdefault(candidate.structure, HeldOut(error, variance, folds.fold))
        columns = list(candidate.commands)
        held_out.error[:, columns], held_out.variance[:, columns] = one.error, one.variance
    return held


def _score(folds: Folds, held: HeldOut, trivial: Array) -> PredictionScore:
    """Of predictions that were held out."""
    use, command = np.isfinite(held.error), folds.score_target
    values = figures(command, np.where(use, command - held.error, 0.0), held.variance, use, trivial)
    return PredictionScore(**vars(values), usable=values)


def _student(error: Array, variance: Array) -> StudentT | None:
    finite = np.isfinite(error)
    return fit_student(error[finite] / np.sqrt(variance[finite]))


PHYSICS = ("identified", "nominal", "linear")
"""Structures that stand for physics alone, the first that a robot has."""
CONSTANT = "constant"
"""What stands for it where a model is no more than that: a command that does not depend on the motion."""


KEYS = {"structure": "rung"}
"""Keys of the file, where they have another name than the field."""


@dataclass(frozen=True, eq=False)
class CrossValidationResiduals:
    """Errors of n samples, NaN where a command was not predicted.

    Attributes:
        rows: (n,) places among the samples in order (`fit_data.in_order`).
        group: (n,) segment.
        error: (n, J) command less prediction, command units.
        variance: (n, J) predicted, noise and calibration included.
        physics: (n, J) error of physics alone; of a model that is no more than these, of what there was
            before: the model file's physics, else a constant command.
        structure: what stands for physics: one of `PHYSICS`, or `CONSTANT`.
    """

    rows: Index
    group: Index
    error: Array
    variance: Array
    physics: Array
    structure: str

    def to_bytes(self) -> bytes:
        """The file."""
        file = io.BytesIO()
        np.savez_compressed(file, **{KEYS.get(name, name): value for name, value in vars(self).items()})
        return file.getvalue()


def residuals_of(selection: ModelSelection) -> CrossValidationResiduals:
    """The cross-validation residuals of a training, without samples that no fold predicted."""
    held = selection.left_out
    structure, physics = _baseline_errors(selection)
    rows = np.flatnonzero(np.isfinite(held.error).any(axis=1))
    moments = held.error[rows], held.variance[rows]
    return CrossValidationResiduals(rows, selection.samples.group[rows], *moments, physics[rows], structure)


SAME = 0.05
"""Part of an error by which it differs from that of physics, below which the command is physics alone."""


def _baseline_errors(selection: ModelSelection) -> tuple[str, Array]:
    """What the choice is compared with, and its errors (n, J): physics alone; of commands that are no more
    than these, what there was before. A model is not held against itself.
    """
    errors = selection.left_out.error
    first = next(name for name in PHYSICS if name in selection.held_out)
    names = [name for name in dict.fromkeys((first, "nominal")) if name in selection.held_out]
    rivals = [(name, selection.held_out[name].error) for name in names] + [(CONSTANT, _constant(selection))]
    rival_errors, used = np.empty_like(errors), []
    for j, error in enumerate(errors.T):
        other = next(pair for pair in rivals if pair[0] == CONSTANT or not _is_same(error, pair[1][:, j]))
        rival_errors[:, j] = other[1][:, j]
        used.append(other[0])
    return next(name for name, _ in rivals if name in used), rival_errors


def _is_same(error: Array, other: Array) -> bool:
    """Whether two errors (n,) are those of one model, where both are known."""
    both = np.isfinite(error) & np.isfinite(other)
    size = float(np.linalg.norm(other[both]))
    return bool(both.any()) and float(np.linalg.norm(error[both] - other[both])) <= SAME * size


def _constant(selection: ModelSelection) -> Array:
    """(n, J) errors of a constant command, the mean of the other folds."""
    command, fold, error = selection.score_target, selection.left_out.fold, selection.left_out.error
    scored = np.where(np.isfinite(error), command, np.nan)
    left = np.full_like(scored, np.nan)
    for number in np.unique(fold):
        in_fold = fold == number
        means = [fold_mean(column) for column in scored[~in_fold].T]
        left[in_fold] = scored[in_fold] - np.array(means)
    return left


def read_residuals(path: Path) -> CrossValidationResiduals:
    """What `CrossValidationResiduals.to_bytes` wrote.

    Raises:
        DataError: no such file, or a damaged one.
    """
    try:
        stored = arrays_of(path.read_bytes())
        names = {key: name for name, key in KEYS.items()}
        fields = {names.get(key, key): value for key, value in stored.items()}
        return CrossValidationResiduals(**{**fields, "structure": str(fields["structure"])})
    except DAMAGE as error:
        raise DataError(
            f"the held-out scores cannot be read ({error})",
            where=str(path),
            next_step="Train again: etude untell the newest log, then etude tell it.",
        ) from error
