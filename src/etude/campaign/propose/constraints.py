"""Constraints of a proposal: its limits, with the tracking errors of the logs, and the facts behind them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from etude.abilities import SupportsLargestError
from etude.campaign.propose.learned_velocity import with_learned_velocity
from etude.campaign.record.controls import FEEDBACK, LEARNED, asked_under, in_words, run_under, speaks_of
from etude.campaign.record.events import Constrained, Exported, Ingested, Table
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import FULL, stored_trajectory
from etude.campaign.record.stored_models import of_another_body, require_stored, stored_model
from etude.errors import DataError, UsageError
from etude.limits.commands import after_run
from etude.limits.tracking_margins import ASSUMED, LOGS_CONSIDERED, Ranges, margins_of, within_room
from etude.logs.alignment.tracking_errors import tracked
from etude.protocols import Limit, Model, Trajectory
from etude.trajectories.json_text import SINGLE
from etude.types import Array, Log, Margins

C = TypeVar("C", bound=Constrained)


@dataclass(frozen=True, eq=False)
class Constraints:
    """Tracking margins of the limits, margins that are not enforced, and the model of the command limits.

    Attributes:
        margins: by form of motion.
        unenforced: sentences on margins that exceed the available range, and on accelerations.
        by_form: the same sentences by form of motion.
        number: round of the model that predicts the commands; None before any log.
        controls: controls of the margins; () for proposals without this field.
    """

    margins: Margins
    unenforced: tuple[str, ...] = ()
    by_form: Mapping[str, tuple[str, ...]] | None = None
    number: int | None = None
    controls: tuple[str, ...] = ()
    _limits: dict[bool, Sequence[Limit]] = field(default_factory=dict, repr=False)
    _models: dict[int, Model | None] = field(default_factory=dict, repr=False)

    def using(self, model: Model) -> Constraints:
        """The constraints with the loaded model of `number`."""
        return replace(self, _models={self.number: model} if self.number is not None else {}, _limits={})

    @property
    def control(self) -> str:
        """The controls in words, for the rows of certificates."""
        return in_words(self.controls)

    def model(self, campaign: Campaign) -> Model | None:
        """The model of `number`. UsageError: its file was changed.

        None before any log, if the model was removed, or if robot.toml now describes another body. Such a
        model would prove the commands of another robot.
        """
        if self.number is not None and self.number not in self._models:
            self._models[self.number] = None
            if of_another_body(campaign, self.number):
                return None
            require_stored(campaign, self.number)
            with contextlib.suppress(UsageError, DataError):
                self._models[self.number] = stored_model(campaign, self.number)
        return None if self.number is None else self._models[self.number]

    def limits(self, campaign: Campaign, *, described: bool = False) -> Sequence[Limit]:
        """The robot's limits less the margins; made once, because limits remember what they proved.

        Args:
            campaign: the folder.
            described: limits of the description alone; an open proposal is checked against these.
        """
        if described not in self._limits:
            self._limits[described] = self._build_limits(campaign, self.margins, described)
        return self._limits[described]

    def _build_limits(self, campaign: Campaign, margins: Margins, described: bool) -> Sequence[Limit]:
        of = campaign.described_limits if described else campaign.limits
        limits, ran = of(margins, self.model(campaign)), self._learned_motion(campaign)
        limits = limits if ran is None else after_run(limits, ran)
        return (
            limits if self.model(campaign) is None else with_learned_velocity(campaign, self.number, limits)
        )

    def _learned_motion(self, campaign: Campaign) -> Trajectory | None:
        """The motion of the log that the model learned last, if known; a slower copy needs less."""
        if self.number is None or self.model(campaign) is None:
            return None
        with contextlib.suppress(UsageError):
            ingested = campaign.round(self.number).ingested
            if ingested is not None and not ingested.foreign and ingested.speed == FULL:
                return stored_trajectory(campaign, self.number)
        return None

    def of(self, trajectory: Trajectory) -> Constraints:
        """The constraints with the sentences about the forms of this motion alone."""
        forms = dict.fromkeys(piece.form for _, _, piece in trajectory.pieces())
        sentences = [sentence for form in forms for sentence in (self.by_form or {}).get(form, ())]
        return replace(
            self, unenforced=tuple(dict.fromkeys(sentences)), _limits=self._limits, _models=self._models
        )

    def margins_of_chain(self, trajectory: Trajectory) -> Margins:
        """The margins with one for the whole chain, the least of its pieces: a receiver does not know the
        pieces.
        """
        pairs = [self.margins[p.form] for _, _, p in trajectory.pieces() if p.form in self.margins]
        if trajectory.form in self.margins or not pairs:
            return self.margins
        table, sure = (np.min([np.asarray(pair[i]) for pair in pairs], axis=0) for i in range(2))
        return {**self.margins, trajectory.form: (table, sure)}

    def limits_as_played(
        self, campaign: Campaign, trajectory: Trajectory, *, described: bool = False
    ) -> Sequence[Limit]:
        """The robot's limits less the margins, for a receiver that does not know the pieces."""
        return self._build_limits(campaign, self.margins_of_chain(trajectory), described)

    def recorded(self, fact: C) -> C:
        """The event with these constraints; without margins it has none."""
        margins = {form: (as_rows(table), as_rows(sure)) for form, (table, sure) in self.margins.items()}
        unenforced = self.unenforced if margins else ()
        return replace(fact, model=self.number, controls=self.controls, margins=margins, unheld=unenforced)


def constraints_then(fact: Constrained | None) -> Constraints:
    """Constraints of a proposal at the time it was made; empty for proposals without margins."""
    if fact is None:
        return Constraints({})
    margins = {form: (as_table(table), as_table(sure)) for form, (table, sure) in fact.margins.items()}
    return Constraints(margins, fact.unheld, number=fact.model, controls=fact.controls)


def as_rows(table: Array | float) -> Table:
    """A table (O, k) for the journal, with None for NaN."""
    return tuple(tuple(None if np.isnan(v) else float(v) for v in row) for row in np.atleast_2d(table))


def as_table(table: Table) -> Array:
    """The table (O, k) of the journal's rows."""
    return np.array([[np.nan if v is None else v for v in row] for row in table], dtype=float)


SETTLED = 4
"""Logs under a feedforward that is learned anew after each of them, with which a margin counts as measured:
what one model left of the error says little of the next. A vehicle then erred by five times as much.
"""
ACCELERATION = 2  # its order among position, velocity, acceleration
IN_WORDS = {"fourier": "Fourier motions", "moves": "moves from pose to pose"}
"""Forms of motion as sentences call them; others by their own name."""
QUANTITIES = ("position", "velocity")


def constraints_now(campaign: Campaign, state: State, *controls: str) -> Constraints:
    """Constraints of a motion that is proposed now.

    Args:
        campaign: the folder. state: of the campaign.
        controls: controls of the run; the constraints hold for each. (): feedback alone.
    """
    controls = controls or (FEEDBACK,)
    by_control = [_margins_under(campaign, state, control) for control in controls]
    margins = {form: _largest([margins[form] for margins, _ in by_control]) for form in by_control[0][0]}
    by_form = {form: tuple(dict.fromkeys(s for _, of in by_control for s in of[form])) for form in margins}
    number = state.trained[-1].number if state.trained else None
    if number is not None and (other := of_another_body(campaign, number)):
        sentence = f"Commands come from the description alone.{other}"
        by_form = {form: (sentence, *sentences) for form, sentences in by_form.items()}
        number = None
    return Constraints(margins, by_form=by_form, number=number, controls=controls)


def _margins_under(
    campaign: Campaign, state: State, control: str
) -> tuple[dict[str, tuple[Array, Array]], dict[str, tuple[str, ...]]]:
    """Margins and their sentences, by form of motion, under one control."""
    errors, ranges = seen_errors(state, control), ranges_of(campaign)
    forms = list(
        dict.fromkeys([*SINGLE, *(form for r in state.ingested if r.ingested for form in r.ingested.tracked)])
    )
    required_margins = _joint_margins(
        margins_of(campaign.config.tracking, ranges, errors, forms, _error_bounds(campaign)), errors
    )
    young = {form for form, tables in errors.items() if control == LEARNED and len(tables) < SETTLED}
    margins, by_form = {}, {}
    last_start = _last_start(campaign, state, control)
    for form, (table, confidence) in required_margins.items():
        sure = np.full_like(table, ASSUMED) if form in young else np.asarray(confidence)
        reduced = within_room(table, sure, ranges, campaign.config.tracking.most)
        margins[form] = reduced
        by_form[form] = (
            *_insufficient_margins(campaign, table, reduced[0]),
            *_accelerations(campaign, form, errors.get(form, ())),
            *(last_start if form in errors else ()),
        )
    return margins, by_form


def _largest(pairs: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """The largest of several margins (O, k), each with its own certainty."""
    if len(pairs) == 1:
        return pairs[0]
    tables, sure = (np.stack(parts) for parts in zip(*pairs, strict=True))
    most = np.fmax.reduce(tables)
    return most, np.where(tables == most, sure, np.inf).min(axis=0, initial=1.0)


def constraints_under(campaign: Campaign, number: int, control: str) -> Constraints:
    """Constraints of a proposal under a control, whether it was proposed for this control or not.

    For a control that the proposal was not written for, the present logs of that control give the margins.
    Before any such log, the proposal's own margins are assumed.
    """
    asked = campaign.round(number).asked
    if not asked_under(asked) or control in asked_under(asked):
        return constraints_then(asked)
    written = [e.fact for e in campaign.events() if e.number == number]
    for fact in reversed(written):
        if isinstance(fact, Exported) and fact.controls == (control,):
            return constraints_then(fact)
    if seen_errors(campaign.state(), control):
        return constraints_now(campaign, campaign.state(), control)
    constraints = constraints_then(asked)
    assumed = {
        form: (table, np.full_like(table, ASSUMED)) for form, (table, _) in constraints.margins.items()
    }
    return replace(constraints, margins=assumed, controls=(control,), _limits={})


def with_tracking_errors(
    campaign: Campaign, number: int, log: Log, trajectory: Trajectory, ingested: Ingested, control: str
) -> Ingested:
    """The ingested log with its control (see `run_under`) and the largest tracking errors by form of motion.

    A run below full speed gets no errors, because they are smaller.
    """
    ingested = replace(ingested, control=run_under(campaign, number, control))
    if ingested.speed != FULL:
        return ingested
    tracking = tracked(log, trajectory, campaign.kind.path)
    start = None if tracking.start is None else (tracking.start.until, as_rows(tracking.start.errors))
    return replace(
        ingested, tracked={form: as_rows(table) for form, table in tracking.errors.items()}, start=start
    )


def start_in_words(campaign: Campaign, ingested: Ingested | None) -> str:
    """A sentence about the start transient of a log, which no margin includes; "" without a transient."""
    if ingested is None or ingested.start is None:
        return ""
    until, errors = ingested.start
    units, table = campaign.channel(campaign.kind.path).units, as_table(errors)
    rows = zip(campaign.axes, units, table[0], table[1], strict=True)
    text = ", ".join(f"{axis} by {e:.3g} {unit} and {v:.3g} {unit}/s" for axis, unit, e, v in rows)
    return (
        f"Start: in the first {until:.3g} s the tracking error had not settled; no margin contains it: "
        f"{text}."
    )


def seen_errors(state: State, control: str) -> dict[str, list[Array]]:
    """Largest errors (O, k) of each used log under that control, by form of motion, oldest first."""
    errors: dict[str, list[Array]] = {}
    for one in sorted(state.ingested, key=lambda r: r.ingested_at):
        if one.ingested is not None and speaks_of(one.ingested, control):
            for form, table in one.ingested.tracked.items():
                errors.setdefault(form, []).append(as_table(table))
    return errors


def _last_start(campaign: Campaign, state: State, control: str) -> tuple[str, ...]:
    """Sentences about the start transient of the newest log under that control that has one."""
    rounds = [
        r
        for r in state.ingested
        if r.ingested and speaks_of(r.ingested, control) and r.ingested.start is not None
    ]
    newest = max(rounds, key=lambda r: r.ingested_at, default=None)
    return () if newest is None else (start_in_words(campaign, newest.ingested),)


def ranges_of(campaign: Campaign) -> Ranges:
    """Ranges of the path and of its rate in the robot's description. UsageError: home is outside."""
    limits, path = campaign.kind.expected(campaign.spec).limits, campaign.kind.path
    rate = next((c.name for c in campaign.channels if c.derivative_of == path), "")
    home = np.asarray(campaign.kind.home(campaign.spec))
    lower, upper = limits[path]
    if out := [
        name for name, outside in zip(campaign.axes, (home < lower) | (home > upper), strict=True) if outside
    ]:
        raise UsageError(
            f"the home of the kind of robot {campaign.kind.name} is outside the limits of {', '.join(out)}",
            where=campaign.spec.name,
            next_step="Correct the limits in robot.toml, or the plug-in: no motion starts outside the "
            "limits.",
        )
    return Ranges.of(limits[path], limits.get(rate), home, campaign.channel(path).units)


def _joint_margins(margins: Margins, errors: Mapping[str, Sequence[Array]]) -> Margins:
    """Margins for forms that occur in one motion: each keeps at least the position margins that logs gave
    the others, since the error of one piece lasts into the next.
    """
    measured = [margins[form][0][0] for form in errors if form in margins]
    least = np.max(measured, axis=0) if measured else np.nan
    return {
        form: (np.concatenate([np.fmax(table[0], least)[None], table[1:]]), confidence)
        for form, (table, confidence) in margins.items()
    }


def _error_bounds(campaign: Campaign) -> Array | None:
    """Largest position errors (k,) that the feedback gains allow; None for unknown gains."""
    kind = campaign.kind
    return np.asarray(kind.largest_error(campaign.spec)) if isinstance(kind, SupportsLargestError) else None


def _insufficient_margins(campaign: Campaign, needed: Array, available: Array) -> list[str]:
    """A sentence for each margin that exceeds the available range."""
    units = campaign.channel(campaign.kind.path).units
    return [
        f"Tracking: the error in {QUANTITIES[order]} of {axis} may reach {needed[order, j]:.3g} "
        f"{units[j]}{'/s' * order}; the margin is only {available[order, j]:.3g}, because a larger one "
        "leaves too little motion."
        for order in range(len(needed))
        for j, axis in enumerate(campaign.axes)
        if available[order, j] < needed[order, j]
    ]


def _accelerations(campaign: Campaign, form: str, errors: Sequence[Array]) -> list[str]:
    """A sentence for each form about the acceleration errors of the last logs, which have no margin."""
    last = [table[ACCELERATION] for table in errors[-LOGS_CONSIDERED:] if len(table) > ACCELERATION]
    if not last:
        return []
    units, where = campaign.channel(campaign.kind.path).units, IN_WORDS.get(form, form)
    rows = list(zip(campaign.axes, np.fmax.reduce(last).tolist(), units, strict=True))
    known = [f"up to {value:.3g} {unit}/s^2 ({axis})" for axis, value, unit in rows if not math.isnan(value)]
    hidden = [axis for axis, value, _ in rows if math.isnan(value)]
    beyond = f"Acceleration: tracking exceeded the plan in {where} by {', '.join(known)}."
    noisy = (
        "Acceleration: the noise of logged positions hides by how much tracking exceeded the plan in "
        f"{where}: {', '.join(hidden)}."
    )
    return [sentence for sentence, some in ((beyond, known), (noisy, hidden)) if some]
