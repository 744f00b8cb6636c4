"""What limits are held with: margins from what logs tell of tracking, and the model that says what drives
must give; now, or as they stood when a motion was asked.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from etude.campaign.folder import Campaign
from etude.campaign.proposals import FULL, stored_trajectory
from etude.campaign.state import State
from etude.campaign.stored import stored_model
from etude.contracts import Array, Limit, Log, Margins, Model, Trajectory
from etude.errors import DataError, UsageError
from etude.limits.believed import after_run
from etude.limits.tracking import LAST, Ranges, margins_of, within_room
from etude.logs.tracked import largest_errors
from etude.trajectories.json_text import SINGLE

TRACKED, MARGINS, UNHELD, MODEL = "tracked", "margins", "unheld", "model"
"""Facts: largest errors by form, of a `told` event; of an `asked` one what was kept, what was not, and the
round whose model said what the drives must give.
"""
ACCELERATION = 2
IN_WORDS = {"fourier": "Fourier motions", "moves": "moves from pose to pose"}
"""Forms of motion as sentences call them; others by their own name."""
QUANTITIES = ("position", "velocity")


@dataclass(frozen=True, eq=False)
class Kept:
    """What is kept of the limits for tracking, what is not, and whose word counts for commands.

    Attributes:
        margins: by form of motion.
        unheld: sentences: margins that would have left no room, and accelerations.
        by_form: the same sentences, by the form of motion that they are about.
        number: of the round whose model says what drives must give; None before any log.
    """

    margins: Margins
    unheld: tuple[str, ...] = ()
    by_form: Mapping[str, tuple[str, ...]] | None = None
    number: int | None = None
    _limits: dict[bool, Sequence[Limit]] = field(default_factory=dict, repr=False)
    _models: dict[int, Model | None] = field(default_factory=dict, repr=False)

    def using(self, model: Model) -> Kept:
        """With the model of `number`, which is at hand."""
        return replace(self, _models={self.number: model} if self.number is not None else {}, _limits={})

    def model(self, campaign: Campaign) -> Model | None:
        """The model of `number`; None before any log, or where it is gone since."""
        if self.number is not None and self.number not in self._models:
            self._models[self.number] = None
            with contextlib.suppress(UsageError, DataError):
                self._models[self.number] = stored_model(campaign, self.number)
        return None if self.number is None else self._models[self.number]

    def limits(self, campaign: Campaign, *, described: bool = False) -> Sequence[Limit]:
        """The robot's, less the margins; made once, since they remember what they proved.

        described: of the description alone, which a proposal that is open already is held against.
        """
        if described not in self._limits:
            self._limits[described] = self._made(campaign, self.margins, described)
        return self._limits[described]

    def _made(self, campaign: Campaign, margins: Margins, described: bool) -> Sequence[Limit]:
        of = campaign.described_limits if described else campaign.limits
        limits, ran = of(margins, self.model(campaign)), self._ran(campaign)
        return limits if ran is None else after_run(limits, ran)

    def _ran(self, campaign: Campaign) -> Trajectory | None:
        """The motion that taught the model last, if it is known; a slower copy asks for less."""
        if self.number is None or self.model(campaign) is None:
            return None
        with contextlib.suppress(UsageError):
            told = campaign.round(self.number).told or {}
            if not told.get("foreign", True) and told.get("speed") == FULL:
                return stored_trajectory(campaign, self.number)
        return None

    def of(self, trajectory: Trajectory) -> Kept:
        """With the sentences about this motion, one piece after the other."""
        forms = dict.fromkeys(piece.form for _, _, piece in trajectory.pieces())
        own = [sentence for form in forms for sentence in (self.by_form or {}).get(form, ())]
        return replace(self, unheld=tuple(dict.fromkeys(own)), _limits=self._limits, _models=self._models)

    def margins_of_chain(self, trajectory: Trajectory) -> Margins:
        """With one for the whole of a chain, the least of its pieces': a receiver knows no pieces."""
        own = [self.margins[p.form] for _, _, p in trajectory.pieces() if p.form in self.margins]
        if trajectory.form in self.margins or not own:
            return self.margins
        table, sure = (np.min([np.asarray(pair[i]) for pair in own], axis=0) for i in range(2))
        return {**self.margins, trajectory.form: (table, sure)}

    def limits_as_played(
        self, campaign: Campaign, trajectory: Trajectory, *, described: bool = False
    ) -> Sequence[Limit]:
        """The robot's, less the margins of a motion whose receiver knows no pieces."""
        return self._made(campaign, self.margins_of_chain(trajectory), described)

    def as_facts(self) -> dict[str, Any]:
        """For the `asked` event; nothing where nothing is kept."""
        facts: dict[str, Any] = {} if self.number is None else {MODEL: self.number}
        if not self.margins:
            return facts
        margins = {form: [_lists(own) for own in pair] for form, pair in self.margins.items()}
        return {**facts, MARGINS: margins, UNHELD: list(self.unheld)}


def kept_now(campaign: Campaign, state: State) -> Kept:
    """What is kept of the limits of a motion that is asked for now."""
    errors, ranges = seen_errors(state), ranges_of(campaign)
    forms = list(dict.fromkeys([*SINGLE, *errors]))
    wanted = _meeting(margins_of(campaign.config.tracking, ranges, errors, forms, _known(campaign)), errors)
    margins, by_form = {}, {}
    for form, (table, confidence) in wanted.items():
        kept = within_room(table, np.asarray(confidence), ranges, campaign.config.tracking.most)
        margins[form] = kept
        by_form[form] = (
            *_short(campaign, table, kept[0]),
            *_accelerations(campaign, form, errors.get(form, ())),
        )
    return Kept(margins, by_form=by_form, number=state.trained[-1].number if state.trained else None)


def kept_then(asked: Mapping[str, Any] | None) -> Kept:
    """What was kept when a proposal was made; nothing of proposals that are older than margins."""
    facts = asked or {}
    margins = {form: (_array(table), _array(sure)) for form, (table, sure) in facts.get(MARGINS, {}).items()}
    return Kept(margins, tuple(facts.get(UNHELD, ())), number=facts.get(MODEL))


def errors_told(campaign: Campaign, log: Log, trajectory: Trajectory, speed: int) -> dict[str, Any]:
    """The fact of a log: its largest errors by form; none of a run below full speed, which errs less."""
    found = largest_errors(log, trajectory, campaign.kind.path) if speed == FULL else {}
    return {TRACKED: {form: _lists(table) for form, table in found.items()}} if found else {}


def seen_errors(state: State) -> dict[str, list[Array]]:
    """By form, the largest errors (orders, k) of each log that is used, oldest first."""
    found: dict[str, list[Array]] = {}
    for one in sorted(state.told, key=lambda r: str((r.told or {}).get("time", ""))):
        for form, table in ((one.told or {}).get(TRACKED) or {}).items():
            found.setdefault(form, []).append(_array(table))
    return found


def ranges_of(campaign: Campaign) -> Ranges:
    """Of the path and its rate, as the robot's description limits them."""
    limits, path = campaign.kind.expected(campaign.spec).limits, campaign.kind.path
    rate = next((c.name for c in campaign.channels if c.derivative_of == path), "")
    home = campaign.kind.home(campaign.spec)
    return Ranges.of(limits[path], limits.get(rate), home, campaign.channel(path).units)


def _meeting(margins: Margins, errors: Mapping[str, Sequence[Array]]) -> Margins:
    """The same for forms that logs have shown in turn: where one ends and the next begins, both are kept."""
    own = [margins[form][0][0] for form in errors if form in margins]
    out = {}
    for form, (table, confidence) in margins.items():
        most = np.max(own, axis=0) if form in errors else table[0]
        out[form] = np.concatenate([most[None], table[1:]]), confidence
    return out


def _known(campaign: Campaign) -> Array | None:
    """(k,) largest position errors that the gains allow; None of kinds that know no gains."""
    largest = getattr(campaign.kind, "largest_error", None)
    return None if largest is None else np.asarray(largest(campaign.spec))


def _short(campaign: Campaign, wanted: Array, kept: Array) -> list[str]:
    """A sentence for each margin that would have left no room."""
    units = campaign.channel(campaign.kind.path).units
    return [
        f"Tracking: {QUANTITIES[order]} of {axis} may be left by {wanted[order, j]:.3g} {units[j]}"
        f"{'/s' * order}, of which {kept[order, j]:.3g} is kept: more would leave too little room."
        for order in range(len(wanted))
        for j, axis in enumerate(campaign.axes)
        if kept[order, j] < wanted[order, j]
    ]


def _accelerations(campaign: Campaign, form: str, errors: Sequence[Array]) -> list[str]:
    """What the last logs say of accelerations, which have no margin; a sentence for each form."""
    last = [own[ACCELERATION] for own in errors[-LAST:] if len(own) > ACCELERATION]
    if not last:
        return []
    units = campaign.channel(campaign.kind.path).units
    most = zip(campaign.axes, np.max(last, axis=0), units, strict=True)
    text = ", ".join(f"{axis} up to {value:.3g} {unit}/s^2" for axis, value, unit in most)
    return [f"Acceleration is not held by the robot: it was left by {text} in {IN_WORDS.get(form, form)}."]


def _lists(table: Array | float) -> Any:
    return [[None if np.isnan(v) else float(v) for v in row] for row in np.atleast_2d(table)]


def _array(table: Sequence[Sequence[float | None]]) -> Array:
    return np.array([[np.nan if v is None else v for v in row] for row in table], dtype=float)
