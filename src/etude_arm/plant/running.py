"""The compiled arm, advanced a few control ticks at a time, for feedforward that is learned on the way."""

from __future__ import annotations

from etude.types import Array
from etude_arm.plant.compiled import advance, at_rest, constants
from etude_arm.plant.parameters import ArmParameters
from etude_arm.plant.trace import LoopInputs, Trace


class RunningArm:
    """One arm on its way (implements `trace.Running`); the same compiled loop as a whole run, to the bit.

    Args:
        arm: its parameters.
        q: (dof,) angles at rest, rad.
    """

    def __init__(self, arm: ArmParameters, q: Array) -> None:
        self._state = at_rest(q)
        self.change(arm)

    def change(self, parameters: ArmParameters) -> None:
        """From the next tick on the arm has these parameters; angles, rates and bristles stay."""
        self._arm = constants(parameters)

    def advance(self, inputs: LoopInputs) -> Trace:
        """Goes on over the ticks of `inputs`."""
        return advance(self._arm, self._state, inputs)
