"""What was kept of the limits when a motion was asked: margins, the control that they are of, and the model
that says what drives must give.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from etude.campaign.record.controls import CONTROLS, asked_under, in_words
from etude.campaign.record.folder import Campaign
from etude.campaign.record.proposals import FULL, stored_trajectory
from etude.campaign.record.stored import require_stored, stored_model
from etude.errors import DataError, UsageError
from etude.limits.commands import after_run
from etude.protocols import Limit, Model, Trajectory
from etude.types import Array, Margins

MARGINS, UNHELD, MODEL = "margins", "unheld", "model"
"""Facts of an `asked` event: what was kept, what was not, and the round whose model said what the drives must
give.
"""


@dataclass(frozen=True, eq=False)
class Constraints:
    """What is kept of the limits for tracking, what is not, and whose word counts for commands.

    Attributes:
        margins: by form of motion.
        unheld: sentences: margins that would have left no room, and accelerations.
        by_form: the same sentences, by the form of motion that they are about.
        number: of the round whose model says what drives must give; None before any log.
        controls: that the margins are of; none of proposals that are older than this.
    """

    margins: Margins
    unheld: tuple[str, ...] = ()
    by_form: Mapping[str, tuple[str, ...]] | None = None
    number: int | None = None
    controls: tuple[str, ...] = ()
    _limits: dict[bool, Sequence[Limit]] = field(default_factory=dict, repr=False)
    _models: dict[int, Model | None] = field(default_factory=dict, repr=False)

    def using(self, model: Model) -> Constraints:
        """With the model of `number`, which is at hand."""
        return replace(self, _models={self.number: model} if self.number is not None else {}, _limits={})

    @property
    def control(self) -> str:
        """The controls in words, for the rows of certificates."""
        return in_words(self.controls)

    def model(self, campaign: Campaign) -> Model | None:
        """The model of `number`; None before any log, or where it is gone. UsageError: it was changed."""
        if self.number is not None and self.number not in self._models:
            self._models[self.number] = None
            require_stored(campaign, self.number)
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

    def of(self, trajectory: Trajectory) -> Constraints:
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
        """For the `asked` event; no margins where nothing is kept."""
        facts: dict[str, Any] = {} if self.number is None else {MODEL: self.number}
        facts |= {CONTROLS: list(self.controls)} if self.controls else {}
        if not self.margins:
            return facts
        margins = {form: [as_lists(own) for own in pair] for form, pair in self.margins.items()}
        return {**facts, MARGINS: margins, UNHELD: list(self.unheld)}


def kept_then(asked: Mapping[str, Any] | None) -> Constraints:
    """What was kept when a proposal was made; nothing of proposals that are older than margins."""
    facts = asked or {}
    margins = {
        form: (as_table(table), as_table(sure)) for form, (table, sure) in facts.get(MARGINS, {}).items()
    }
    return Constraints(
        margins, tuple(facts.get(UNHELD, ())), number=facts.get(MODEL), controls=asked_under(facts)
    )


def as_lists(table: Array | float) -> Any:
    """A table (O, k) for the journal, null for NaN."""
    return [[None if np.isnan(v) else float(v) for v in row] for row in np.atleast_2d(table)]


def as_table(table: Sequence[Sequence[float | None]]) -> Array:
    """(O, k) of the journal's lists."""
    return np.array([[np.nan if v is None else v for v in row] for row in table], dtype=float)
