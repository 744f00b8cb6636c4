"""The page on changed robots, followed as a new user would: the load is noticed, named, and answered."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_docs import ROOT
from test_log_pages import lines

from etude.campaign import open_campaign
from etude.cli import main

PAGE = ROOT / "docs" / "changed_robot.md"


@pytest.mark.slow
def test_the_rehearsal_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    said: list[str] = []
    rehearsal = [words for words in lines(PAGE) if words[0] not in ("study", "bench")]
    codes = []
    for words in rehearsal:
        codes.append(main(words))
        said.append("".join(capsys.readouterr()))
    assert [words[0] for words in rehearsal] == ["init", "simulate", "simulate", "status", "tell", "simulate"]
    assert codes == [0, 0, 6, 0, 0, 0]  # the page says so
    assert (
        "Log 3 is not used for training yet: the robot differs from the one that the model was trained on"
        in said[2]
    )
    assert "a load was taken up or put down" in said[2]
    assert said[3].startswith("RED: log 3: the robot differs from the one")
    assert "Learned: 3." in said[4]
    assert [r.number for r in open_campaign(tmp_path / "lab").state().learned] == [3, 4]
