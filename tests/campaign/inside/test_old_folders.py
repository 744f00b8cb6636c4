"""Folders that Étude 0.1 made: every line of their journals is read whole, and they go on as they were.

`fixtures/one_round` is a simulated arm of two joints after one round; its test runs were taken out.
`fixtures/every_event` is its journal after events of all kinds, with the files that people edit.
`fixtures/*.status.json` is what `etude status --json` of that version said of them.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, fields
from pathlib import Path

import pytest

from etude import ask, load_model, status, tell
from etude.campaign import Evaluated, event_from_json, event_to_json, open_campaign
from etude.campaign.record.events import FACTS, plain

pytestmark = pytest.mark.as_logged

FIXTURES = Path(__file__).parents[1] / "fixtures"


def lines(name: str) -> list[str]:
    return (FIXTURES / name / "journal.jsonl").read_text().splitlines()


@pytest.mark.parametrize("name", ["one_round", "every_event"])
def test_no_fact_of_a_line_is_lost(name: str) -> None:
    for line in lines(name):
        event, said = event_from_json(line), json.loads(line)
        assert event_from_json(event_to_json(event)) == event
        own = {f.name: getattr(event.fact, f.name) for f in fields(event.fact)}
        held = json.loads(json.dumps(plain(asdict(event) | own | {"event": event.event})))
        if isinstance(event.fact, Evaluated):
            held[f"tracking_error_{event.fact.unit}"] = list(event.fact.errors)
        assert {key: held[key] for key in said.keys() - {"previous", "seal"}}.items() <= said.items()


LATER = {"run_began", "motion_sent", "motion_ended", "run_ended"}
"""Events that Étude 0.1 did not have."""


def test_events_of_all_kinds_are_there() -> None:
    assert {json.loads(line)["event"] for line in lines("every_event")} == set(FACTS) - LATER


@pytest.mark.parametrize("name", ["one_round", "every_event"])
def test_status_says_what_it_said(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(FIXTURES / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    found = json.loads(json.dumps(status(open_campaign(Path(name)))))
    assert found == json.loads((FIXTURES / f"{name}.status.json").read_text())


def test_the_model_is_read_and_the_next_motion_designed(tmp_path: Path) -> None:
    shutil.copytree(FIXTURES / "one_round", tmp_path / "lab")
    lab = open_campaign(tmp_path / "lab")
    assert load_model(lab.path).commands == ("shoulder", "elbow")
    proposal = ask(lab, go_on=True)
    assert proposal.certificate.ok
    assert (proposal.number, proposal.new, lab.round(2).asked is not None) == (2, True, True)
    assert tell(lab, lab.path / "runs" / "0001.parquet", foreign=True).learned == (3,)
