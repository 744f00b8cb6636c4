"""ONNX operators of an arm's inputs, and of the friction state between instants."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from etude._runtime.operators import Piece, Value, joined
from etude.types import Array
from etude_arm.memory import MEMORY_RATE


def inputs_piece(inputs: Any) -> Piece:
    """Operators of `ArmInputs`; memory of each joint: friction state, position behind the play, start."""
    reads, J = inputs.names, len(inputs.stick_velocity)
    remembers = inputs.presliding is not None

    def draw(states: Mapping[str, Value], memory: Value | None) -> tuple[Value, Value | None]:
        q, qd, qdd = (states[name] for name in reads)
        columns, after = [q, qd, qdd, *((qd / threshold).of("Tanh") for threshold in inputs.thresholds)], None
        if remembers:
            standstill = (-(abs(qd) / inputs.slow)).of("Exp")
            held = standstill * 0.0
            if memory is not None:
                sigma, after = followed(q, memory, inputs.play, inputs.presliding)
                held = sigma * standstill
            columns += [held, standstill]
        return joined(columns), after

    return Piece(reads, draw, 2 * J + 1 if remembers else 0, MEMORY_RATE if remembers else 0.0)


def followed(q: Value, memory: Value, play: Array, length: Array) -> tuple[Value, Value]:
    """Friction state (n, J) at q (n, J), and the memory after (n, 2 J + 1): Dahl's law, as
    `memory.remembered`.
    """
    J = len(length)
    before, started = memory.at(range(J, 2 * J)), memory.at([2 * J])
    p = started * before + (1.0 - started) * q
    behind = p.most(q - play).least(q + play)
    step = behind - p
    side = step.of("Sign")
    sigma = side + (memory.at(range(J)) - side) * (-(abs(step) / length)).of("Exp")
    return sigma, joined([sigma, behind, started * 0.0 + 1.0])
