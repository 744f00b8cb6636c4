"""Lines of `etude status`."""

from __future__ import annotations

import shutil
from pathlib import Path

from etude import open_campaign, status
from etude.cli.status import _lines as lines

FIXTURE = Path(__file__).parents[2] / "campaign" / "fixtures" / "one_round"


def test_status_says_when_the_choice_no_longer_matters(tmp_path: Path) -> None:
    shutil.copytree(FIXTURE, tmp_path / "lab")
    found = status(open_campaign(tmp_path / "lab"))
    assert found["choice"] is None
    assert not any("no longer matters" in line for line in lines(found))
    for choice, said in ((0.2, False), (0.051, False), (0.049, True), (0.0, True)):
        text = [line for line in lines({**found, "choice": choice}) if "no longer matters" in line]
        assert bool(text) == said
    assert "4.9 %" in next(line for line in lines({**found, "choice": 0.049}) if "matters" in line)
