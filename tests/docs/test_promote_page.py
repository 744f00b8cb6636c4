"""The page on promoting and watching, followed as a new user would."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_docs import ROOT
from test_log_pages import lines

from etude.campaign import open_campaign
from etude.cli import main

PAGE = ROOT / "docs" / "promote_watch.md"


@pytest.mark.slow
def test_the_rehearsal_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    said, codes = [], []
    # what needs a real robot, and studies, is told of after the rehearsal
    for words in lines(PAGE)[:8]:
        codes.append(main(words))
        said.append(capsys.readouterr().out)
    assert codes == [0, 0, 0, 0, 0, 0, 6, 6]  # the log of the changed arm waits for an answer
    assert "is in use now" in said[2]
    assert "trajectory 7, feedforward, deg" in said[3]
    assert "Promoted: the model of log 6" in said[4]
    assert "No change of the robot" in said[5]
    assert "a load was taken up or put down" in said[7]
    assert "Proposed: trajectory" in said[7]
    state = open_campaign(tmp_path / "lab").state()
    assert [r.number for r in state.learned] == [1, 2, 3, 4, 5, 6]
    assert set(state.rounds[7].runs) == {"without", "with"}
