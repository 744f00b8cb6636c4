"""The next proposal, computed while the robot returns: in a process of its own, or at once where time is not
ours.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

from etude.campaign.propose.ask import ask
from etude.campaign.record.folder import Campaign, Say
from etude.errors import (
    DataError,
    EtudeError,
    NumericalError,
    StopRuleReached,
    UnsafeTrajectoryError,
    UsageError,
)

KINDS = (UsageError, DataError, UnsafeTrajectoryError, StopRuleReached, NumericalError)
"""Errors that `ask` ends with, as its JSON names them."""


@dataclass(eq=False)
class NextProposal:
    """A proposal that is being computed.

    Attributes:
        control: that it is asked for, unless one is open. beside: in a process of its own, which has a
            processor and an interpreter to itself, else when somebody waits for it.
    """

    campaign: Campaign
    control: str
    beside: bool
    say: Say
    _process: subprocess.Popen[str] | None = None

    def begin(self) -> None:
        """Start training and the proposal; return at once."""
        if self.beside:
            arguments = [sys.executable, "-m", "etude", "ask", str(self.campaign.path), "--json"]
            self._process = subprocess.Popen(
                [*arguments, *(["--control", control] if (control := self._control()) else [])],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is the robot's, and this work is not lost by it
                text=True,
            )

    def number(self) -> int:
        """Of the proposal. Raises what `ask` raises."""
        if self._process is None:
            return ask(self.campaign, control=self._control(), say=self.say).number
        text = self._process.communicate()[0]
        return _number(text, self._process.returncode)

    def end(self) -> None:
        """Stop waiting for the proposal."""
        if self._process is not None and self._process.returncode is None:
            self._process.terminate()
            self._process.communicate()

    def _control(self) -> str:
        """That of an open proposal counts: its margins are made."""
        return "" if self.campaign.state().proposals else self.control


def _number(text: str, code: int) -> int:
    try:
        answer = json.loads(text.strip().splitlines()[-1])
    except (ValueError, IndexError):
        raise EtudeError(f"planning the next motion ended with code {code} and no message") from None
    if "error" in answer:
        raise _error(answer["error"])
    return int(answer["number"])


def _error(error: dict[str, Any]) -> EtudeError:
    """The error with which the other process ended."""
    kind = next((candidate for candidate in KINDS if candidate.__name__ == error.get("kind")), EtudeError)
    return kind(str(error["fact"]), where=str(error["where"]), next_step=str(error["next_step"]))
