"""A decision on several logs together, and the evidence of their moving joints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from etude.logs.evidence.likelihood import ColumnEvidence, WhitenedMotion
from etude.logs.evidence.rows import AS_LOGGED, DELAYS, FilteredRows
from etude.types import Array, Index, Mask

Level = Literal["certain", "ask", "note", "silent"]

CLEAR = 10.0  # log odds to the next best decision: of 151 exchanged pairs two look inverted by e^8 and e^9
LEAST_ROWS = 40  # fewer tell nothing
MOST_GROUPS = 12  # logs that may differ from the others, of the newest


@dataclass(frozen=True, eq=False)
class Decision:
    """The result of the checks on several logs together; k joints.

    Attributes:
        level: certain: refused unless repaired; ask: a question; note: repaired with a note; silent.
        check: its name; "" of a silent one.
        logs: which of the logs it is about; orders, directions and weights are judged of new ones.
        by: of a sign: 1 or -1 (k,); of an order: the column of each joint's command (k,); of a delay: s.
        odds: log odds against the logs as they are. ahead: against the next best decision.
        sign_odds: (k,) log odds of the right sign to the inverted one, of the commands as they are.
        moving, strange: (k,) joints that count, and those that no sign explains.
        why: what decides a sign, or explains the data equally well: "weight" of the model file, "time" that
            runs backwards, another "order". "late" of a silent one whose commands may be late.
        positions: of a sign or an order, log odds that the positions are wrong and not the commands; 0 where
            no model file tells.
        exchangeable: of a silent one, joints whose commands another order explains as well.
    """

    level: Level
    sign_odds: Array
    moving: Mask
    strange: Mask
    check: str = ""
    logs: tuple[int, ...] = ()
    by: tuple[float, ...] = ()
    odds: float = 0.0
    ahead: float = np.inf
    why: str = ""
    positions: float = 0.0
    exchangeable: tuple[int, ...] = ()

    @property
    def clear(self) -> bool:
        """Whether it is far ahead of every other decision; otherwise nothing is repaired."""
        return self.ahead >= CLEAR


@dataclass(frozen=True, eq=False)
class JointEvidence:
    """The evidence of moving joints `joint_indices` (m,), computed on demand.

    Attributes:
        orders: whether it is about orders of the columns, and not about delays; both are computed on demand.
    """

    rows: FilteredRows
    joint_indices: Index
    motion: WhitenedMotion
    orders: bool = True

    @classmethod
    def of(cls, rows: FilteredRows | None) -> JointEvidence | None:
        """None if the rows are too few, or nothing moves."""
        if rows is None or len(rows.t) < LEAST_ROWS or not rows.moving.any():
            return None
        joints = np.flatnonzero(rows.moving)
        return cls(rows, joints, WhitenedMotion.of(rows, joints))

    def with_command(self, command: Array) -> JointEvidence:
        """The same motion with other commands (n, k, d) on it."""
        return replace(self, rows=replace(self.rows, command=command))

    @cached_property
    def without_turns(self) -> JointEvidence:
        """The evidence of the delays alone, in the rows without reversals, where stiction plays no part."""
        motion, command = self.motion.without_turns, self.rows.command[..., : len(DELAYS)]
        return JointEvidence(
            replace(motion.rows, command=command, groups=()), self.joint_indices, motion, orders=False
        )

    @cached_property
    def delayed(self) -> ColumnEvidence:
        """(m len(DELAYS)) of joints with their own columns, at each delay."""
        every, delays = np.arange(len(self.joint_indices)), np.arange(len(DELAYS))
        joints = np.repeat(every, len(delays))
        return self.motion.evidence(self.rows.command, joints, joints, np.tile(delays, len(every)))

    @cached_property
    def _in_step(self) -> ColumnEvidence:
        """(m m + m g) of joints with all columns as they were logged, and with their own in the g groups."""
        every = np.arange(len(self.joint_indices))
        groups = np.arange(len(DELAYS), self.rows.command.shape[2])
        joints = np.concatenate([np.repeat(every, len(every)), np.repeat(every, len(groups))])
        columns = np.concatenate([np.tile(every, len(every)), np.repeat(every, len(groups))])
        variants = np.concatenate([np.full(len(every) ** 2, AS_LOGGED), np.tile(groups, len(every))])
        return self.motion.evidence(self.rows.command, joints, columns, variants)

    @property
    def crossed(self) -> ColumnEvidence:
        """(m m) of joints with all columns, as they were logged."""
        return self._in_step.take(slice(0, len(self.joint_indices) ** 2))

    def variant(self, number: int) -> ColumnEvidence:
        """Of each joint's own column in one variant."""
        every, m = np.arange(len(self.joint_indices)), len(self.joint_indices)
        groups = self.rows.command.shape[2] - len(DELAYS)
        if number >= len(DELAYS):
            return self._in_step.take(m * m + every * groups + number - len(DELAYS))
        if number == AS_LOGGED and self.orders:
            return self._in_step.take(every * (m + 1))
        return self.delayed.take(every * len(DELAYS) + number)

    def over(self, values: Array | Mask, fill: float) -> Array:
        """(k,) of all joints, from those of the moving ones (m,)."""
        filled = np.full(len(self.rows.parts), fill, dtype=values.dtype)
        filled[self.joint_indices] = values
        return np.asarray(filled)

    def decision(self, level: Level, variant: int = AS_LOGGED, **more: object) -> Decision:
        """variant: of the commands, in which strange joints are searched."""
        right, inverted = self.variant(AS_LOGGED).signs()
        sign_odds = self.over(right - inverted, 0.0)
        strange = self.over(self.variant(variant).strange(), False)
        return Decision(level, sign_odds, self.rows.moving, strange, **more)  # type: ignore[arg-type]
