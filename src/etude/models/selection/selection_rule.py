"""The selection rule: of each command the structure with the least cross-validated error, if data suffice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from etude.codes import NextStep, Notice, Warn
from etude.models.data.cross_validation import HeldOut, fold_mean
from etude.models.data.fit_data import Folds, seconds_of
from etude.models.selection.member_prediction import PHYSICAL
from etude.protocols import Candidate
from etude.types import Array, Mask

TRAJECTORIES = 2
"""From so many on linear regression competes, and physics have no advantage. Stretches of a single trajectory
are no evidence: they are all near each other, and a regression that fits them best may err without bound on
the next motion."""
CHANCE = 1.0
"""Standard errors by which a structure must predict the folds better to replace the one that is best for all
commands together. Of 48 rounds of two simulated arms the least error alone erred up to 40 times as much on
new motion with one trajectory, and 1.2 to 1.5 times with two or three."""
ROUNDING = 1e-20
"""Part of the mean square of a command below which a squared error is rounding: both are right."""


def choices(folds: Folds, trained: Sequence[Sequence[str]], held: Mapping[str, HeldOut]) -> tuple[str, ...]:
    """The structure of each command.

    Args:
        trained: for each command its structures; of equally good ones the first is taken.
        held: by structure, the samples held out; the same for all.
    """
    config, command = folds.config, folds.samples.command
    if config.rung != "auto":
        return tuple(config.rung for _ in trained)
    power = 1 if config.choose_by == "absolute" else 2
    rounding = (np.sqrt(ROUNDING) * np.sqrt(np.mean(command**2, axis=0))) ** power
    spread = np.maximum(command.std(axis=0) ** power, np.maximum(rounding, np.finfo(float).tiny))
    votes = {structure: held_out.votes(config.choose_by) for structure, held_out in held.items()}
    reference = _reference(folds, trained, {structure: vote / spread for structure, vote in votes.items()})
    return tuple(
        _choice(
            {structure: votes[structure][:, j] for structure in _competing(folds, structures)},
            reference,
            float(rounding[j]),
            config.replace,
        )
        for j, structures in enumerate(trained)
    )


def _reference(folds: Folds, trained: Sequence[Sequence[str]], votes: Mapping[str, Array]) -> str:
    """The structure that is best for all commands together; of one trajectory the best physics, if any."""
    common = [r for r in _competing(folds, trained[0]) if all(r in structures for structures in trained)]
    physics = [structure for structure in common if structure in PHYSICAL]
    relative = {
        structure: fold_mean(np.array([fold_mean(vote) for vote in votes[structure].T]))
        for structure in common
    }
    if folds.config.replace == "every" and physics:
        best = _least({structure: relative[structure] for structure in physics}, 0.0)
        together = {
            structure: np.array([fold_mean(fold) for fold in votes[structure]]) for structure in common
        }
        winners = [structure for structure in common if _on_every_fold(together[structure], together[best])]
        return _least({structure: relative[structure] for structure in (best, *winners)}, 0.0)
    if physics and folds.trajectories < TRAJECTORIES:
        relative = {structure: relative[structure] for structure in physics}
    return _least(relative, 0.0)


def _choice(votes: Mapping[str, Array], reference: str, rounding: float, replace: str) -> str:
    """The structure with the least error of the folds (F,) among those that may replace the reference."""
    wins = _on_every_fold if replace == "every" else _beyond_chance
    better = [structure for structure, vote in votes.items() if wins(vote, votes[reference])]
    return _least({structure: fold_mean(votes[structure]) for structure in (reference, *better)}, rounding)


def _beyond_chance(errors: Array, reference: Array) -> bool:
    """Whether the folds are predicted better than by the reference, by more than the differences scatter."""
    difference = (errors - reference)[np.isfinite(errors - reference)]
    if len(difference) < 2:
        return False
    error = float(np.std(difference, ddof=1)) / np.sqrt(len(difference))
    return bool(np.mean(difference) < -CHANCE * error)


def _on_every_fold(errors: Array, reference: Array) -> bool:
    """Whether each of several folds is predicted better than by the reference."""
    difference = (errors - reference)[np.isfinite(errors - reference)]
    return len(difference) >= 2 and bool(np.all(difference < 0.0))


def _competing(folds: Folds, structures: Sequence[str]) -> list[str]:
    """Those of the structures that may be chosen, as few trajectories say little."""
    if folds.trajectories >= TRAJECTORIES:
        allowed = list(structures)
    else:
        allowed = [structure for structure in structures if not structure.startswith("linear")]
    physics = [structure for structure in allowed if structure in PHYSICAL]
    return physics if physics and folds.trajectories < folds.config.process_from else allowed


def _least(errors: Mapping[str, float], rounding: float) -> str:
    """The structure with the least error; the first of those that are as good, or if nothing was held out."""
    structures = list(errors)
    best = structures[0]
    for structure in structures[1:]:
        if errors[structure] < errors[best] - rounding or np.isnan(errors[best]) > np.isnan(
            errors[structure]
        ):
            best = structure
    return best


def warnings_of(
    folds: Folds, trained: Sequence[Sequence[str]], chosen: Mapping[int, str], held: Mapping[str, HeldOut]
) -> tuple[Notice, ...]:
    """A notice for each command of which linear regression predicts more than a process by itself.

    chosen: by command the structure alone in use.
    """
    notices = []
    squared = {structure: held_out.errors("squared") for structure, held_out in held.items()}
    for j, structure in chosen.items():
        structures = trained[j]
        rival = "gp" if structure.startswith("linear") and "gp" in structures else structure
        if not rival.endswith("gp") or rival == "linear+gp":
            continue
        error, linear = squared[rival][j], squared["linear"][j]
        if not error > linear + ROUNDING * float(np.mean(folds.samples.command[:, j] ** 2)):
            continue
        ratio = float(np.sqrt(error / max(linear, np.finfo(float).tiny)))
        code, step = _outcome(folds, structure)
        notices.append(Notice(code, {"command": folds.commands[j], "ratio": ratio}, step))
    return tuple(notices)


def _outcome(folds: Folds, structure: str) -> tuple[Warn, NextStep | None]:
    """What was done about a process that errs more, and what to do."""
    if structure == "linear":
        return Warn.LINEAR_ALONE, None
    if structure == "linear+gp":
        return Warn.LINEAR_BELOW, None
    if folds.trajectories < TRAJECTORIES:
        return Warn.ONE_TRAJECTORY, NextStep.TELL_ANOTHER
    return Warn.PERHAPS_CHANCE, None


LEAST_STRETCHES, LEAST_MOVING = 2.0, 0.5
"""Motion that errors can be judged by, in stretches of `ModelConfig.stretch_s`, each held out of the other:
of the whole, and of a command's own joint."""
DOUBT = 0.1
"""Part of a command's limit that is the least deviation before that."""


def insufficient_data(folds: Folds) -> Mask:
    """(J,) commands of which there is too little motion to hold any out that differs from the rest.

    A coordinate that is held sags and swings while others move. Its command is the feedback's answer to that,
    which a process predicts to rounding, and which is no dynamics: 70 N m where gravity was 6.
    """
    samples, stretch = folds.samples, folds.config.stretch_s
    seconds = seconds_of(samples)
    moving_s = seconds * np.mean(samples.usable & samples.moving, axis=0)
    few = (moving_s < LEAST_MOVING * stretch) | (seconds < LEAST_STRETCHES * stretch)
    return np.asarray(few if folds.held is None else few | folds.held)


def least_variance(folds: Folds, candidates: Sequence[Candidate]) -> Array | None:
    """(J,) variance of short motion anywhere: what a constant would leave, or what the prior has; None if all
    of it is long enough.

    A controller then gives the model no trust, and no stop rule fires. Designs go on looking at the process.
    """
    few = insufficient_data(folds)
    if not (few.any() and folds.config.calibrate):
        return None
    samples = folds.samples
    variance = np.nanvar(np.where(samples.usable, samples.command, np.nan), axis=0)
    least = np.maximum(variance, (DOUBT * folds.limit) ** 2)
    for candidate in candidates:
        assert candidate.process is not None
        prior = candidate.process.noise_variance + candidate.process.signal_variance
        outputs = list(candidate.commands)
        least[outputs] = np.where(
            candidate.weights > 0.0,
            np.maximum(least[outputs], candidate.units[1] ** 2 * prior),
            least[outputs],
        )
    return np.where(few, least, 0.0)


def notes(folds: Folds) -> tuple[Notice, ...]:
    """What the user should know of short motion."""
    few = insufficient_data(folds)
    if not few.any() or not folds.config.calibrate:
        return ()
    names = ("all commands",) if few.all() else tuple(np.array(folds.commands)[few].tolist())
    fields = {"commands": names, "seconds": float(seconds_of(folds.samples))}
    return (Notice(Warn.TOO_LITTLE_MOTION, fields, NextStep.TELL_MOVING),)
