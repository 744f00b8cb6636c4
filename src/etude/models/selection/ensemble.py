"""Ensembles: additional processes, averaged with weights by their prediction of other motions.

Each member is a row of `CANDIDATES`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude import plugins
from etude.errors import UsageError
from etude.models.accuracy import while_any_moves
from etude.models.config import ModelConfig
from etude.models.data.cross_validation import Base, HeldOut, process_held_out
from etude.models.data.fit_data import Folds, Rows, rows_of, spaced_positions
from etude.models.gp.kernels import own_columns
from etude.models.learned_model import LearnedModel
from etude.models.selection.candidate_errors import CandidateErrors, mixed, of_command
from etude.models.selection.noise_floor import with_process
from etude.models.selection.structures import (
    LearnedStructure,
    alone,
    base_of,
    earlier_of,
)
from etude.progress import counted
from etude.types import Array, Index, Mask

REST_S = 2.0
"""Least time between two samples of a joint at rest that teach, s."""
RESTS = 0.5
"""How much a joint rests, in [0, 1], from which its sample teaches what friction holds."""
COSTS = {"default": 0.1, "all_lin": 10.0}
"""About how long one takes; others 1."""


FEW_SAMPLES = 200
"""Samples for the default's hyperparameters below which a prior of mechanics has something to add: logs of a
minute or two. With four logs it was worse than the default alone."""
INVERTED = -0.3
"""Work of a command over its size below which its sign is wrong: friction's is positive, and conservative
power cancels over a closed motion. Torques measured behind the gear hold no friction and come out near 0."""


@dataclass(frozen=True)
class MemberConfig:
    """How a candidate learns.

    Attributes:
        kernel: name in the group etude.kernels. process: name of the member.
        structures: in which it takes part; where all candidates are stacked, in the first that there is.
        together: all commands in one process; else each by itself.
        standing: samples of standing joints teach too, while another moves.
        own_data: it learns from its own samples and physics (`Sources`), and takes part without a process.
        fit_points, steps, points: at most, of the configuration's; 0: these.
        offered: whether it is worth its time on these data, given the default's samples of each command.
    """

    kernel: str
    process: str = "exact"
    structures: tuple[str, ...] = ("gp",)
    together: bool = False
    standing: bool = False
    own_data: bool = False
    fit_points: int = 0
    steps: int = 0
    points: int = 0
    offered: Callable[[Folds, Sequence[Rows]], bool] = lambda folds, rows: True  # noqa: ARG005

    def config(self, config: ModelConfig) -> ModelConfig:
        """The configuration of this candidate."""
        return replace(
            config,
            kernel=self.kernel,
            process=self.process,
            fit_points=min(self.fit_points or config.fit_points, config.fit_points),
            inducing=config.inducing
            if self.standing or self.own_data
            else 0,  # a Lagrangian is for few samples
            points=min(self.points or config.points, config.points),
            steps=self.steps or config.steps,
        )

    def fault(self) -> str:
        """Why its package cannot be used; "" if it can."""
        try:
            plugins.load("etude.kernels", self.kernel)
            plugins.load("etude.models", self.process)
        except UsageError as error:
            return error.fact
        return ""


def _any_rests(folds: Folds, rows: Sequence[Rows]) -> bool:  # noqa: ARG001
    """Joints stand while others move, and inputs remember how they came there."""
    stands = standing(folds, range(len(folds.commands)))
    return bool(stands.any()) and any(op == "memory" for *_, op in folds.inputs.columns)


def _few_samples(folds: Folds, rows: Sequence[Rows]) -> bool:  # noqa: ARG001
    return all(len(group_rows.chosen) < FEW_SAMPLES for group_rows in rows)


def _is_conservative(folds: Folds, rows: Sequence[Rows]) -> bool:
    """Few samples, and commands that can be of one energy: in one unit, none with the wrong sign."""
    units = folds.samples.log.channels["command"].units
    return _few_samples(folds, rows) and len(set(units)) == 1 and bool(np.all(work_sign(folds) > INVERTED))


CANDIDATES: dict[str, MemberConfig] = {
    "standing": MemberConfig(
        "standing", structures=("identified+gp", "gp"), standing=True, offered=_any_rests
    ),
    "slow": MemberConfig(
        "standing", structures=("identified+gp",), standing=True, own_data=True, offered=_any_rests
    ),
    "ripple": MemberConfig("structured", structures=("identified+gp",), own_data=True),
    "gip_lin": MemberConfig("gip_lin", fit_points=110, offered=_few_samples),
    "all_lin": MemberConfig(
        "ard_se", "all_lin", together=True, fit_points=110, steps=60, points=300, offered=_is_conservative
    ),
}
"""Beside "default", by the name that `model.candidates` gives."""


Sources = Mapping[str, tuple[Folds, Base]]
"""By name of a candidate the samples and the physics that are its own."""


def work_sign(folds: Folds) -> Array:
    """(J,) Σ command · speed / Σ |command · speed| where the joint moves; 0 where no speed is known."""
    samples, names = folds.samples, [channel for channel, *_ in folds.inputs.columns]
    speeds = [n for n in dict.fromkeys(names) if samples.log.channels[n].derivative_of == names[0]]
    if not speeds:
        return np.zeros(len(folds.commands))
    use = samples.usable & samples.moving
    power = np.where(use, samples.command * samples.log[speeds[0]], 0.0)
    return np.asarray(power.sum(axis=0) / np.maximum(np.abs(power).sum(axis=0), np.finfo(float).tiny))


def beside_default(
    folds: Folds,
    groups: Sequence[Mapping[str, LearnedStructure]],
    bases: Mapping[str, Base],
    sources: Sources,
    rng: np.random.Generator,
    previous: LearnedModel | None,
) -> tuple[list[LearnedStructure], dict[str, str]]:
    """The candidates that `model.candidates` names and the data suffice for, in every structure of theirs. By
    name why others cannot be loaded: a broken package takes no model from anybody.
    """
    structures: list[LearnedStructure] = []
    broken: dict[str, str] = {}
    if not folds.config.averages or len(folds.numbers) < 2:
        return structures, broken
    for name in counted(folds.config.candidates, lambda name: COSTS.get(name, 1.0)):
        for structure in counted(_structures(folds, groups, name, sources)):
            if fault := CANDIDATES[name].fault():
                broken[name] = fault
                continue
            defaults = [group[structure] for group in groups if structure in group]
            source, base = sources.get(name, (folds, bases.get(base_of(structure))))
            every = tuple(j for learned in defaults for j in learned.candidate.commands)
            for commands in counted([every] if CANDIDATES[name].together else [(j,) for j in every]):
                compared = None if len(commands) > 1 else compared_samples(folds, commands[0], defaults)
                structures.append(_learned(source, commands, name, structure, base, rng, previous, compared))
                if CANDIDATES[name].own_data and base is not None:
                    structures.append(_without_process(source, structures[-1], base))
    return structures, broken


def _structures(
    folds: Folds, groups: Sequence[Mapping[str, LearnedStructure]], name: str, sources: Sources
) -> list[str]:
    """In which a candidate takes part; none where the data do not suffice for it."""
    member = CANDIDATES.get(name)
    if member is None or (member.own_data and name not in sources):
        return []
    offered = []
    for structure in member.structures:
        rows = [group[structure].rows for group in groups if structure in group]
        if rows and member.offered(folds, rows):
            offered.append(structure)
    return offered[:1] if folds.config.stacks else offered


def _without_process(folds: Folds, twin: LearnedStructure, base: Base) -> LearnedStructure:
    """The mean function of a candidate by itself."""
    candidate = twin.candidate
    structure = base_of(candidate.structure)
    learned = alone(folds, candidate.commands, twin.rows, structure, base, candidate)
    return replace(learned, candidate=replace(learned.candidate, name=candidate.name))


def _learned(
    folds: Folds,
    group: tuple[int, ...],
    name: str,
    structure: str,
    base: Base | None,
    rng: np.random.Generator,
    previous: LearnedModel | None,
    compared: Mask | None,
) -> LearnedStructure:
    member_config = CANDIDATES[name]
    samples = folds.samples
    if member_config.standing:
        samples = replace(samples, moving=samples.moving | resting(folds))
    member_folds = replace(folds, samples=samples, config=member_config.config(folds.config))
    rows = rows_of(member_folds, group, rng, any_of=member_config.together)
    if member_config.standing:  # samples at rest show little of the motion, so they are added
        rows = _merged(rows_of(replace(member_folds, samples=folds.samples), group, rng), rows, folds, group)
    start = earlier_of(previous, structure, group, folds, name)
    learned = with_process(member_folds, group, rows, structure, base, start, rng, compared)
    return replace(learned, candidate=replace(learned.candidate, name=name))


def resting(folds: Folds) -> Mask:
    """(n, J) samples at which a joint rests while another moves; those in between say neither.

    Around a stick-slip the filter smears the motion: a slow sample is no observation of friction at rest. And
    of one rest all samples are held by the same friction, so that they repeat each other: some are enough.
    """
    samples = folds.samples
    places = [own_columns(folds.inputs.columns, (name,), "rest")[0] for name in folds.commands]
    rests = (folds.X[:, places] >= RESTS) & while_any_moves(samples)
    for mask in rests.T:
        rows = np.flatnonzero(mask)
        mask[np.setdiff1d(rows, rows[spaced_positions(samples.t[rows], samples.group[rows], REST_S)])] = False
    return np.asarray(rests)


def _merged(moving: Rows, every: Rows, folds: Folds, group: tuple[int, ...]) -> Rows:
    """The rows of moving joints, and of the others those at rest."""
    rests = np.asarray(~folds.samples.moving[:, list(group)].all(axis=1))

    def both(places: Index, other: Index) -> Index:
        return np.union1d(places, other[rests[other]])

    return Rows(every.moving, both(moving.kept, every.kept), both(moving.chosen, every.chosen))


def everywhere(folds: Folds, learned: LearnedStructure, compared: Mask) -> tuple[Array, Array]:
    """Errors and calibrated variances (n, m) held out, of standing joints too; NaN where not predicted.

    Each candidate is conditioned on samples of its own, so that together they use more of them. All are
    compared on the same ones: those that score candidates, or what the default held out, `compared`
    (n, J), beside standing joints. Without scored samples, a candidate of all commands, learned from few
    samples, is compared by what it held out itself.
    """
    candidate, held = learned.candidate, learned.held
    outputs, process = list(candidate.commands), candidate.process
    predictions = held if learned.beside is None else _filled(held, learned.beside)
    mask = (
        compared[:, outputs] if folds.scored is not None else standing(folds, outputs) | compared[:, outputs]
    )
    missing = np.flatnonzero((mask & ~np.isfinite(predictions.error)).any(axis=1))
    if len(missing) and process is not None and (len(outputs) == 1 or folds.scored is not None):
        rows = replace(learned.rows, kept=missing)
        more = process_held_out(folds, candidate.commands, rows, candidate.units, process, learned.base)
        predictions = _filled(predictions, more)
    beside = (folds.score_target - folds.samples.command)[:, outputs]
    error = predictions.error if folds.scored is None else np.where(mask, predictions.error + beside, np.nan)
    return error, predictions.variance * candidate.calibration


def _filled(held: HeldOut, more: HeldOut) -> HeldOut:
    """With what another one says where the first says nothing."""
    new = np.isnan(held.error) & np.isfinite(more.error)
    return HeldOut(
        np.where(new, more.error, held.error), np.where(new, more.variance, held.variance), held.fold
    )


def standing(folds: Folds, commands: Sequence[int]) -> Mask:
    """(n, m) where the joints of those commands stand while another moves."""
    outputs = list(commands)
    return np.asarray(while_any_moves(folds.samples)[:, outputs] & ~folds.samples.moving[:, outputs])


def compared_samples(folds: Folds, command: int, defaults: Sequence[LearnedStructure] = ()) -> Mask:
    """(n,) samples of a command that `everywhere` compares candidates on: those that judge, or without them
    those of standing joints, and those that the defaults held out.
    """
    if folds.scored is not None:
        return folds.scored
    mask = standing(folds, [command])[:, 0]
    for learned in defaults:
        if command in learned.candidate.commands:
            place = learned.candidate.commands.index(command)
            mask = mask | np.isfinite(learned.held.error[:, place])
    return np.asarray(mask)


EXPONENT = 4.0
"""Weights go as exp(4 · mean log density): a candidate that is better by half a unit weighs seven times as
much. It was chosen by its errors on the real logs of docs/real_logs.md, where it matters little."""
LEAST_WEIGHT = 0.02
"""A candidate that weighs less for every command is left out."""


def candidate_errors(
    folds: Folds,
    groups: Sequence[Mapping[str, LearnedStructure]],
    others: Sequence[LearnedStructure],
) -> list[CandidateErrors]:
    """All candidates, group by group, the default's first; all on the samples of the defaults."""
    defaults = [part for group in groups for part in group.values()]
    order = list(dict.fromkeys(part.candidate.structure for part in others))
    others = sorted(others, key=lambda part: order.index(part.candidate.structure))
    use = _compared(folds, defaults)
    return [CandidateErrors(part, *everywhere(folds, part, use)) for part in (*defaults, *others)]


@dataclass(frozen=True, eq=False)
class Average:
    """A structure with all its candidates.

    Attributes:
        parts: the default's of each group first. shares: of each its (m,) weights within the structure.
        held: what the average says of the samples held out, calibration included.
    """

    parts: tuple[LearnedStructure, ...]
    shares: tuple[Array, ...]
    held: HeldOut


def averaged(folds: Folds, candidates: Sequence[CandidateErrors], defaults: int) -> Average:
    """The candidates of a structure, weighed for each command by their density over what all predicted.

    candidates: the `defaults` of the groups first.
    """
    parts, shape = [one.part for one in candidates], folds.samples.command.shape
    weights = np.zeros((len(parts), shape[1]))
    by_command = [of_command(candidates, j) for j in range(shape[1])]
    for j, (places, errors, variances) in enumerate(by_command):
        weights[places, j] = weighed(errors, variances)
    needed = weights.max(axis=1) >= LEAST_WEIGHT
    weights = np.where(needed[:, None], weights, 0.0)
    weights /= np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
    for row, default in zip(weights, parts[:defaults], strict=False):  # unpredicted, it stays in use
        row[[j for j in default.candidate.commands if not weights[:, j].any()]] = 1.0
    error, variance = np.full(shape, np.nan), np.full(shape, np.nan)
    for j, (places, errors, variances) in enumerate(by_command):
        error[:, j], variance[:, j] = mixed(errors, variances, weights[places, j])
    held = HeldOut(error, variance, folds.fold).at(_compared(folds, parts[:defaults]))
    used = [k for k in range(len(parts)) if needed[k] or k < defaults]
    shares = tuple(weights[k, list(parts[k].candidate.commands)] for k in used)
    return Average(tuple(parts[k] for k in used), shares, held)


def weighed(error: Array, variance: Array) -> Array:
    """(C,) weights of candidates by errors and variances (C, n), NaN where not predicted; 0 if nowhere.

    The first alone where no sample was predicted by all.
    """
    there = np.isfinite(error).any(axis=1) if len(error) else np.zeros(0, dtype=np.bool_)
    weights = np.zeros(len(error))
    if not there.any():
        return weights
    use = np.isfinite(error[there]).all(axis=0)
    if not use.any():
        weights[np.flatnonzero(there)[:1]] = 1.0
        return weights
    e, v = error[there][:, use], variance[there][:, use]
    density = -0.5 * np.mean(np.log(v) + e**2 / v, axis=1)
    share = np.exp(EXPONENT * (density - density.max()))
    weights[there] = share / share.sum()
    return weights


def _compared(folds: Folds, defaults: Sequence[LearnedStructure]) -> Mask:
    """(n, J) the samples on which structures are compared: those that judge all candidates, or those that the
    defaults were conditioned on.
    """
    if folds.scored is not None:
        return folds.error_mask
    use = np.zeros(folds.samples.command.shape, dtype=np.bool_)
    for part in defaults:
        use[:, list(part.candidate.commands)] = np.isfinite(part.held.error)
    return use


def averages(folds: Folds, every: Sequence[CandidateErrors], defaults: int) -> dict[str, Average]:
    """By structure that has other candidates than its `defaults`, the first of `every`, its average."""
    by_structure = {}
    for structure in dict.fromkeys(one.part.candidate.structure for one in every[defaults:]):
        standard, beside = (
            [one for one in part if one.part.candidate.structure == structure]
            for part in (every[:defaults], every[defaults:])
        )
        by_structure[structure] = averaged(folds, [*standard, *beside], len(standard))
    return by_structure
