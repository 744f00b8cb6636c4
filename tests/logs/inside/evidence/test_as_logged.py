"""Files marked `as_logged` take wrong commands as they are every day; at night these too are judged."""

from __future__ import annotations

import pytest
from made_motion import COMMAND, Q, moved

from etude.logs.evidence import command_signs, contradictions

pytestmark = pytest.mark.as_logged


def test_an_inverted_log_is_asked_about_at_night_alone(pytestconfig: pytest.Config) -> None:
    log = moved()
    wrong = log.put(COMMAND, -log["command"])
    everyday = pytestconfig.getoption("markexpr") == "not slow"
    assert (command_signs.sign_decision([wrong], Q).level == "silent") is everyday
    assert contradictions.change_within(log, Q, None) is None
