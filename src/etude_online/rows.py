"""Rows as a control loop gives them, held against the robot's channels before anything looks at them.

A channel of another length is a mistake of the program around, and no fault of a wire: it is refused in
words, where arithmetic would raise, spread one number over all joints, or hold the last command for ever.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Channel, Row
from etude_online.guard_effort import FED_BACK


class Rows:
    """What rows hold.

    Args:
        channels: of the kind, by name. commands: names of the model's, of which `command_fb` has one each.
    """

    def __init__(self, channels: Mapping[str, Channel], commands: Sequence[str]) -> None:
        units = next((c.units for c in channels.values() if c.role == "command"), ())
        told = {FED_BACK: (tuple(commands), units)}
        self._known = told | {name: (c.parts, c.units) for name, c in channels.items()}

    def taken(self, row: Row, what: str) -> dict[str, Array]:
        """The row as arrays (parts,); channels that nobody knows stay as they are.

        Args:
            what: names the row in words, "planned" or "measured".

        Raises:
            UsageError: a channel has another number of parts than the robot's, or is no numbers.
        """
        found = dict(row)
        for name in found.keys() & self._known.keys():
            found[name] = self._numbers(name, found[name], what)
        return found

    def require(self, row: Row, names: Sequence[str], what: str, why: str) -> None:
        """UsageError: the row lacks one of those names; why: a sentence that says what it is for."""
        missing = [name for name in dict.fromkeys(names) if name not in row]
        if missing:
            each = "; ".join(f"{name}: {self._wanted(name)}" for name in missing)
            raise UsageError(
                f"the {what} row lacks {', '.join(missing)}", next_step=f"Put in every row {each}. {why}"
            )

    def _numbers(self, name: str, values: Array, what: str) -> Array:
        try:
            found = np.asarray(values, dtype=float)
        except (TypeError, ValueError):
            raise UsageError(
                f"{name} of the {what} row holds no numbers", next_step=f"Give {self._wanted(name)}."
            ) from None
        count = len(self._known[name][0])
        if found.shape == (count,):
            return found
        if found.shape == () and count == 1:
            return found[None]
        size = {0: "is a single number", 1: f"has length {found.size}"}.get(found.ndim, f"is {found.shape}")
        raise UsageError(
            f"{name} of the {what} row {size}, not {count}",
            next_step=f"Give {self._wanted(name)}.",
        )

    def _wanted(self, name: str) -> str:
        """As "4 numbers in rad (waist, shoulder, elbow, wrist)"."""
        if name not in self._known:
            return "an array of its parts"
        parts, units = self._known[name]
        of = " and ".join(dict.fromkeys(units))
        number = "1 number" if len(parts) == 1 else f"{len(parts)} numbers"
        return f"{number}{f' in {of}' if of else ''} ({', '.join(parts)})"
