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
        either_side: of a sign or an order, positions and commands have directions of their own, and nothing
            tells which of them are wrong.
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
    either_side: bool = False
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
        other: another model of the same motion, as likely before the data; None: there is none.
    """

    rows: FilteredRows
    joint_indices: Index
    motion: WhitenedMotion
    orders: bool = True
    other: WhitenedMotion | None = None

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
    def clock(self) -> JointEvidence:
        """The evidence of the delays. Where a joint turns round, friction has a memory of its way, or any
        command is possible: the data decide joint by joint.
        """
        rows = replace(self.rows, command=self.rows.command[..., : len(DELAYS)], groups=())
        motions = self.motion.with_memory, self.motion.without_turns
        return JointEvidence(rows, self.joint_indices, motions[0], orders=False, other=motions[1])

    @cached_property
    def delayed(self) -> ColumnEvidence:
        """(m len(DELAYS)) of joints with their own columns, at each delay."""
        every, delays = np.arange(len(self.joint_indices)), np.arange(len(DELAYS))
        joints = np.repeat(every, len(delays))
        return self._evidence(joints, joints, np.tile(delays, len(every)))

    def _evidence(self, joints: Index, columns: Index, variants: Index) -> ColumnEvidence:
        evidence = self.motion.evidence(self.rows.command, joints, columns, variants)
        if self.other is None:
            return evidence
        return evidence.either(self.other.evidence(self.rows.command, joints, columns, variants))

    @cached_property
    def _in_step(self) -> ColumnEvidence:
        """(m m + m g) of joints with all columns as they were logged, and with their own in the g groups."""
        every = np.arange(len(self.joint_indices))
        groups = np.arange(len(DELAYS), self.rows.command.shape[2])
        joints = np.concatenate([np.repeat(every, len(every)), np.repeat(every, len(groups))])
        columns = np.concatenate([np.tile(every, len(every)), np.repeat(every, len(groups))])
        variants = np.concatenate([np.full(len(every) ** 2, AS_LOGGED), np.tile(groups, len(every))])
        return self._evidence(joints, columns, variants)

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
        if number == AS_LOGGED:
            return self._in_step.take(every * (m + 1)) if self.orders else self._as_logged
        return self.delayed.take(every * len(DELAYS) + number)

    @cached_property
    def _as_logged(self) -> ColumnEvidence:
        """Of each joint's own column; it does not wait for all delays."""
        every = np.arange(len(self.joint_indices))
        if "delayed" in self.__dict__:
            return self.delayed.take(every * len(DELAYS) + AS_LOGGED)
        return self._evidence(every, every, np.full(len(every), AS_LOGGED))

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
