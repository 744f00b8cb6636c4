"""Training: learning of all new logs at once, with an estimate of the model's own error."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from etude.abilities import SupportsNotes
from etude.campaign.propose.typical_motions import typical_motions
from etude.campaign.record.events import BlockScores, NewMotionScores, PrequentialScore, Trained
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.record.journal import MODEL, jsonable
from etude.campaign.record.state import Round, State
from etude.campaign.record.stored_models import (
    LEFT_OUT,
    LINEAR,
    MIXED,
    body_of,
    check_model,
    groups_of,
    held_commands,
    ingested_samples,
    is_pruned,
    known_groups,
    label,
    prune,
    stored_log,
    stored_model,
)
from etude.codes import NextStep, Notice, Warn, stated
from etude.design.latents import latents_of
from etude.design.objective import MOTIONS, reference_states
from etude.errors import DataError, NumericalError
from etude.logs.cleaning.filters import LONGEST_LAG, median_rate, resample
from etude.models.accuracy import Figures, PredictionScore, figures, prediction_score, trivial_prediction
from etude.models.data.cross_validation import held_out_blocks, split_blocks
from etude.models.learned_model import LearnedModel
from etude.models.process_abilities import HasKernel
from etude.models.selection.linear import LinearPhysics
from etude.models.selection.model_selection import (
    ModelSelection,
    prequential,
    residuals_of,
    select_structures,
)
from etude.models.selection.width import LEAST_LOGS
from etude.models.store import save_model
from etude.progress import part
from etude.protocols import Candidate, Inputs
from etude.storage import write_atomic
from etude.threads import threads_for
from etude.types import Array, Mask, Samples

MOST_LOGS, MOST_SECONDS = 100, 1200.0
"""Largest number of logs, and of seconds of their motion, in a training."""
TRAIN_STREAM = 2
"""Stream that separates the random numbers of training from those of proposals and tests."""
BLOCKS = 20
"""Number of blocks of a log; some of them are held out."""
GAP_S = 0.5
"""s on either side of a held-out block of the first proposal's log that belong to neither part: the filter
spreads a command over about that time. Recordings have no gap, because they are short and their documented
figures were computed without one.
"""


@dataclass(frozen=True)
class TrainingOutcome:
    """Result of learning a log.

    Attributes:
        files: stored models.
        fact: the training.
    """

    files: list[Path]
    fact: Trained


Learner = Callable[[Campaign, State, int], TrainingOutcome]
"""Function that learns log `number` with all logs ingested before it; `learn_log` except in tests."""


@threads_for(0)
def learn_pending(campaign: Campaign, learner: Learner | None = None, say: Say = lambda _: None) -> list[int]:
    """Learn every ingested log that waits for no answer, all together; return their numbers.

    One training takes all of them, and is recorded under the last of their numbers. If it fails, they are
    learned one after the other. A log that still cannot be learned (an axis never moved) waits for the next
    one. The caller holds the lock.

    Raises:
        DataError, NumericalError: not even all logs together can be learned.
    """
    learn = learner or learn_log
    numbers = [r.number for r in campaign.state().pending]
    try:
        _learn_together(campaign, learn, numbers, say)
        return numbers
    except (DataError, NumericalError) as error:
        failure: DataError | NumericalError | None = error
    done: list[int] = []
    for number in numbers if len(numbers) > 1 else []:
        try:
            _learn_together(campaign, learn, [number], say)
        except (DataError, NumericalError) as error:
            failure = error
            continue
        failure = None
        done.append(number)
    if failure is not None:
        raise failure
    return done


def learn_again(campaign: Campaign, learner: Learner | None = None, say: Say = lambda _: None) -> list[int]:
    """Learn all training logs in a new training: pending ones, or otherwise those of the last one again.

    For campaigns that an earlier version learned, or whose campaign.toml was edited. A promoted model stays
    in use. Returns the numbers of the logs that the training ended with; [] without any log.

    Raises:
        UsageError: another process is writing to the campaign.
        DataError, NumericalError: as `learn_pending`.
    """
    with campaign.writing():
        state = campaign.state()
        if state.pending or not state.trained:
            return learn_pending(campaign, learner, say)
        last = state.trained[-1]
        together = last.trained.together if last.trained else ()
        numbers = [n for n in together if state.rounds[n].learned] or [last.number]
        _learn_together(campaign, learner or learn_log, numbers, say)
        return numbers


def _learn_together(campaign: Campaign, learn: Learner, numbers: Sequence[int], say: Say) -> None:
    """One training, and its commit. Errors as `learn_pending`."""
    if not numbers:
        return
    say(f"Learning log{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}.")
    learned = learn(campaign, campaign.state(), numbers[-1])
    together = tuple(numbers) if len(numbers) > 1 else ()
    campaign.commit(replace(learned.fact, together=together), numbers[-1], learned.files)
    prune(campaign)


REFERENCE_STREAM = 5
"""The reference motions of the stop rule are the same for all rounds, so that its numbers can be compared."""
STATES = 100  # reference states at which the expected error is averaged
SPEEDS = ("rad/s", "m/s")
FASTEST = 99.0  # per cent of states that are slower than what counts as reached: single rows may be wrong
SLOW = 0.5
"""Part of the reference motions' speed below which logs say little of it: what grows with its square is a
quarter."""


def with_forecast(
    fact: Trained,
    model: LearnedModel,
    before: LearnedModel | None,
    campaign: Campaign,
    state: State,
    samples: Samples,
) -> Trained:
    """The training with the model's expected errors, for each command in its unit.

    forecast_deviation: root mean square error expected at the reference states, calibrated;
    latent_deviation, noise_deviation: of the process, uncalibrated, and of its noise;
    moved: largest change of a log lengthscale since the model before, in the same structures, or null.
    """
    rng = np.random.default_rng([state.seed, REFERENCE_STREAM])
    motions = typical_motions(campaign, rng, MOTIONS)
    latents = latents_of(model)
    groups = [latent.commands for latent in latents]
    latent, noise, expected = (np.zeros(len(model.commands)) for _ in range(3))
    references = reference_states(model.inputs, groups, STATES, motions)
    for view, X in zip(latents, references, strict=True):
        commands = list(view.commands)
        latent[commands] = view.factors * np.sqrt(np.mean(view.posterior.predict(X)[1]))
        noise[commands] = view.factors * np.sqrt(view.posterior.noise_variance)
        expected[commands] = [expected_variance(model, j, X) for j in commands]
    return replace(
        fact,
        forecast_deviation=tuple(np.sqrt(expected).tolist()),
        latent_deviation=tuple(latent.tolist()),
        noise_deviation=tuple(noise.tolist()),
        moved=None if before is None else _length_scale_change(model, before),
        warnings=(
            *fact.warnings,
            *slow_motion(model.inputs, samples, np.concatenate(references), fact.unmoved),
        ),
    )


def slow_motion(
    inputs: Inputs, samples: Samples, reference: Array, unmoved: Sequence[str]
) -> tuple[Notice, ...]:
    """Notice of axes that moved far more slowly than at the reference states (r, D); unmoved ones apart."""
    speeds = np.percentile(np.abs(inputs.of_log(samples.log)), FASTEST, axis=0)
    reference_speeds = np.percentile(np.abs(reference), FASTEST, axis=0)
    parts = {
        axis: float(speeds[k] / reference_speeds[k])
        for k, (_, axis, unit, op) in enumerate(inputs.columns)
        if unit in SPEEDS and not op and axis not in unmoved and speeds[k] < SLOW * reference_speeds[k]
    }
    if not parts:
        return ()
    return (
        Notice(Warn.SLOW_MOTION, {"axes": tuple(parts), "part": max(parts.values())}, NextStep.TELL_FASTER),
    )


def expected_variance(model: LearnedModel, command: int, X: Array) -> float:
    """Expected mean squared error of a command at model inputs X (r, D), without the noise of samples."""
    total = 0.0
    for candidate in model.candidates:
        if command in candidate.commands and candidate.process is not None:
            place = candidate.commands.index(command)
            variance = candidate.process.predict(X)[1][:, place] * candidate.units[1, place] ** 2
            total += candidate.weights[place] * candidate.calibration[place] * float(variance.mean())
    return total if model.width is None else total * float(model.width[command])


def _length_scale_change(model: LearnedModel, before: LearnedModel) -> float | None:
    """Largest |change| of a log length scale over all commands; None if kernels differ or are missing."""
    moves = []
    for command, structure in enumerate(model.chosen):
        now, then = (_posterior(m.candidates, structure, command) for m in (model, before))
        if not (isinstance(now, HasKernel) and isinstance(then, HasKernel)):
            return None
        if now.theta.shape != then.theta.shape:
            return None
        lengths = np.array([role == "length" for role in now.kernel.roles()])
        if lengths.any():
            moves.append(float(np.abs(now.theta - then.theta)[lengths].max()))
    return max(moves, default=None)


def _posterior(candidates: tuple[Candidate, ...], structure: str, command: int) -> Any:
    """The process of a command in that structure, if there is one."""
    for candidate in candidates:
        if (
            candidate.structure == structure
            and command in candidate.commands
            and candidate.process is not None
        ):
            place = candidate.commands.index(command)
            for posterior, places in candidate.process.latents():
                if place in places:
                    return posterior
    return None


def learn_log(campaign: Campaign, state: State, number: int) -> TrainingOutcome:
    """Score the newest model on log `number` and the other pending ones, which are new to it; then train on
    all ingested logs.
    """
    if not (state.trained and is_pruned(campaign, state.trained[-1].number)):
        check_model(campaign, state)
    trained = [r for r in state.trained if r.number != number]
    every, logs, new = _training_logs(state, number)
    samples = ingested_samples(campaign, logs)
    inputs = campaign.kind.inputs(campaign.spec, campaign.config).fitted(samples)
    before = _comparable(campaign, trained, inputs)
    rng = np.random.default_rng([state.seed, number, TRAIN_STREAM])
    # with two or more motions each is predicted from the others; with one motion, blocks from the rest
    blocks = len(np.unique(samples.group)) < LEAST_LOGS
    held = _held_commands(campaign, samples)
    with part(0.5 if blocks else 1.0):
        selection = _selected(campaign, samples, inputs, rng, before, held)
    files = _save_files(campaign, number, selection)
    fact = replace(
        _trained(campaign, state, every, logs, samples, selection),
        models=_scores(before, inputs, samples, known_groups(campaign, logs[:-new])),
        new_motion=None if blocks else _new_motion(selection),
        predicted_by=trained[-1].trained.chosen if trained and trained[-1].trained else None,
        unmoved=tuple(np.array(campaign.command.parts)[held].tolist()),
    )
    fact = with_forecast(fact, selection.model, before, campaign, state, samples)
    if blocks:
        ingested = state.rounds[number].ingested
        gap = 0.0 if ingested is not None and ingested.foreign else GAP_S
        with part(0.5):
            fact = _with_blocks(fact, campaign, number, rng, gap)
    return TrainingOutcome(files, fact)


def _training_logs(state: State, number: int) -> tuple[list[int], list[int], int]:
    """All ingested logs, those of them that teach, and how many of these, the last ones, are new."""
    waiting = [r.number for r in state.pending if r.number < number]
    every = [*(r.number for r in state.learned if r.number not in (number, *waiting)), *waiting, number]
    logs = teaching(state, every)
    return every, logs, 1 + sum(n in waiting for n in logs)


def _selected(
    campaign: Campaign,
    samples: Samples,
    inputs: Inputs,
    rng: np.random.Generator,
    before: LearnedModel | None = None,
    held: Mask | None = None,
) -> ModelSelection:
    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    physics, limit = kind.physics(spec, config), kind.limit(spec)
    return select_structures(samples, inputs, physics, limit, config.model, rng, before, held)


def _save_files(campaign: Campaign, number: int, selection: ModelSelection) -> list[Path]:
    """The files of the model and of its held-out residuals."""
    path, residuals = campaign.model_folder(number) / MODEL, campaign.model_folder(number) / LEFT_OUT
    save_model(path, selection.model)
    write_atomic(residuals, residuals_of(selection).to_bytes())
    return [path, residuals]


def _trained(
    campaign: Campaign,
    state: State,
    every: Sequence[int],
    logs: Sequence[int],
    samples: Samples,
    selection: ModelSelection,
) -> Trained:
    """What is recorded of a training, without what compares it with an earlier model."""
    ingested = [r.ingested for r in state.ingested if r.ingested and r.number in every]
    inputs = selection.model.inputs
    return Trained(
        logs=tuple(logs),
        held_out_mae=_left_out_errors(selection),
        chosen=label(selection.model.in_use),
        rungs=tuple(selection.chosen),
        calibrated=selection.model.calibrated,
        row_scatter=_row_scatter(campaign, logs, samples),
        robot_seconds=float(sum(one.robot_seconds for one in ingested)),
        recipe=tuple(_recipe_sentences(state, logs, samples)),
        inputs={name: np.asarray(a).tolist() for name, a in inputs.arrays().items()},
        warnings=(*_notes(inputs), *_subset_notice(every, logs), *selection.model.warnings),
        body=body_of(campaign),
    )


def teaching(state: State, logs: Sequence[int]) -> list[int]:
    """The training logs among `logs`, in order: all, or a subset that bounds the cost of a training.

    The subset is spread evenly over all training logs and includes the last one.
    """
    ingested = [state.rounds[number].ingested for number in logs]
    seconds = sum(one.robot_seconds for one in ingested if one is not None)
    count = min(len(logs), MOST_LOGS, max(1, int(len(logs) * MOST_SECONDS / max(seconds, MOST_SECONDS))))
    return [logs[(i + 1) * len(logs) // count - 1] for i in range(count)]


def _row_scatter(campaign: Campaign, logs: Sequence[int], samples: Samples) -> tuple[float, ...]:
    """(J,) root mean square difference of recorded and filtered commands in the newest log that repeats no
    other: sensor noise and motion above the filter's cutoff. () without such a log.
    """
    segments = groups_of(campaign, logs)
    groups = {number: {group for _, group in starts} for number, starts in segments.items()}
    count = Counter(group for members in groups.values() for group in members)
    single = [number for number in logs if all(count[group] == 1 for group in groups[number])]
    if not single:
        return ()
    log = stored_log(campaign, single[-1])
    newest = samples.take(np.isin(samples.group, [*groups[single[-1]]]))
    # commands of a vehicle are delayed by the lag of its motors
    lags = np.arange(0.0, LONGEST_LAG, 1.0 / median_rate(log.t))
    each = [resample(log.t, log["command"], newest.t - lag) - newest.command for lag in lags]
    squares = np.square(min(each, key=lambda left: float(np.mean(left**2))))
    use = newest.usable & newest.moving
    return tuple(np.sqrt(squares.sum(axis=0, where=use) / np.maximum(use.sum(axis=0), 1)).tolist())


def _subset_notice(every: Sequence[int], logs: Sequence[int]) -> tuple[Notice, ...]:
    """Notice that not all logs are used for training."""
    return (
        (Notice(Warn.SOME_TEACH, {"some": len(logs), "all": len(every)}),) if len(logs) < len(every) else ()
    )


def _notes(inputs: Inputs) -> tuple[Notice, ...]:
    return stated(inputs.notes) if isinstance(inputs, SupportsNotes) else ()


def _held_commands(campaign: Campaign, samples: Samples) -> Mask:
    """(J,) commands of coordinates that are held in all logs, if each coordinate has its own command."""
    path = samples.log.get(campaign.kind.path)  # may be missing in logs of flights
    return held_commands(campaign, [] if path is None else [path])


def _comparable(campaign: Campaign, trained: Sequence[Round], inputs: Inputs) -> LearnedModel | None:
    """The newest model, or None if it has other inputs: some logs lack channels, or [data] was edited. Also
    None if its file was removed after newer models, whose logs were retracted later.
    """
    if not trained or is_pruned(campaign, trained[-1].number):
        return None
    before = stored_model(campaign, trained[-1].number)
    return before if tuple(before.inputs.columns) == tuple(inputs.columns) else None


def _scores(
    before: LearnedModel | None, inputs: Inputs, samples: Samples, earlier: int
) -> dict[str, PrequentialScore]:
    """Scores of each structure of the earlier model and of the baseline, on the groups after the first
    `earlier`.
    """
    newest = samples.group >= earlier
    if not newest.any():  # repeated logs contain no new motion
        return {}
    new = samples.take(newest)
    scores: dict[str, PredictionScore] = {}
    if before is not None:
        scores = prequential(before, new, samples.take(~newest), MIXED)
    if not newest.all():  # fitted to the earlier logs alone
        mean = LinearPhysics(inputs)(samples.take(~newest))
        scores[LINEAR] = prediction_score(new, mean.predict(new.log))
    return {structure: _plain(one) for structure, one in scores.items()}


def _recipe_sentences(state: State, logs: Sequence[int], samples: Samples) -> list[str]:
    """Sentences of the recipe, beside the repairs of each log: the lag of motors, for example."""
    facts = [state.rounds[n].ingested for n in logs]
    ingested = {sentence for one in facts if one is not None for sentence in one.repairs}
    return [sentence for sentence in samples.log.repairs if sentence not in ingested]


def _plain(score: PredictionScore) -> PrequentialScore:
    every = score.usable
    return PrequentialScore(
        nmse=jsonable(score.nmse),
        z2=jsonable(score.z2),
        coverage=jsonable(score.coverage),
        msll=jsonable(score.msll),
        nmse_all=jsonable(every.nmse),
        z2_all=jsonable(every.z2),
        coverage_all=jsonable(every.coverage),
    )


def _left_out_errors(selection: ModelSelection) -> dict[str, float | None]:
    """Mean absolute error of each structure on logs that it had not seen, over commands; null if unknown."""
    errors = {
        structure: float(np.mean(held.errors("absolute"))) for structure, held in selection.held_out.items()
    }
    return dict(zip(errors, jsonable(list(errors.values())), strict=True))


def _new_motion(selection: ModelSelection) -> NewMotionScores:
    """Scores of the structure in use, and of linear regression, on logs left out."""
    residuals, linear = selection.left_out, selection.held_out[LINEAR].error
    samples, count = selection.samples, len(np.unique(residuals.fold))
    trivial = trivial_prediction(samples)

    def scored(error: Array, variance: Array | None) -> Figures:
        use = np.isfinite(error)
        mean = np.where(use, selection.score_target - error, 0.0)
        return figures(selection.score_target, mean, variance, use, trivial)

    used, plain = scored(residuals.error, residuals.variance), scored(linear, None)
    values = {name: jsonable(getattr(used, name)) for name in ("nmse", "z2", "coverage", "msll")}
    return NewMotionScores(count, PrequentialScore(**values), jsonable(plain.nmse))


def _with_blocks(
    fact: Trained, campaign: Campaign, number: int, rng: np.random.Generator, gap_s: float
) -> Trained:
    """The training with the scores of a log's blocks, or with a warning if it cannot be learned alone."""
    try:
        return replace(fact, held_out=_held_out(campaign, ingested_samples(campaign, [number]), rng, gap_s))
    except DataError as error:
        why = f"{error.fact} ({error.where})" if error.where else error.fact
        warning = Notice(Warn.NO_BLOCKS, {"log": number, "why": why})
        return replace(fact, warnings=(*fact.warnings, warning))


def _held_out(campaign: Campaign, log: Samples, rng: np.random.Generator, gap_s: float) -> BlockScores:
    """nMSE per command on held-out blocks of one log, for each structure and linear regression."""
    train, test = split_blocks(log, gap_s)
    inputs = campaign.kind.inputs(campaign.spec, campaign.config).fitted(train)
    selection = _selected(campaign, train, inputs, rng)
    scores = prequential(selection.model, test, together=MIXED)
    nmse = {structure: jsonable(score.nmse) for structure, score in scores.items() if structure != LINEAR}
    linear = LinearPhysics(selection.model.inputs)(train).predict(test.log)
    beside = prediction_score(test, linear)
    nmse["linear regression"] = jsonable(beside.nmse)
    every = {
        structure: jsonable(score.usable.nmse) for structure, score in scores.items() if structure != LINEAR
    }
    every["linear regression"] = jsonable(beside.usable.nmse)
    return BlockScores(tuple(held_out_blocks()), BLOCKS, label(selection.model.in_use), nmse, every)
