"""Campaigns that Étude 0.1 made: opened, replayed, asked and told as if nothing had happened."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from etude.campaign.evaluate.status import status
from etude.campaign.ingest.tell import tell
from etude.campaign.propose.ask import ask
from etude.campaign.record.folder import Campaign, open_campaign
from etude.campaign.record.stored_models import load_model, newest_model
from etude.campaign.simulation import simulate
from etude.errors import DataError

FIXTURES = Path(__file__).parent / "fixtures"
LOGS = {"arm": "arm_run3.csv", "quadrotor": "quadrotor_run2.parquet"}
AGAIN = "The model was stored by Étude 0.1: it is trained again from its logs."


@pytest.fixture(params=["arm", "quadrotor"])
def old(request: pytest.FixtureRequest, tmp_path: Path) -> Campaign:
    """A copy of the folder, with one proposal that is open."""
    shutil.copytree(FIXTURES / f"{request.param}_0_1", tmp_path / "lab")
    return open_campaign(tmp_path / "lab")


def test_it_is_opened_and_replayed(old: Campaign) -> None:
    arm = old.kind.name == "arm"
    state = old.state()
    assert [r.number for r in state.trained] == ([1, 2] if arm else [1])
    assert [r.number for r in state.proposals] == ([3] if arm else [2])
    found = status(old)
    assert found["problems"] == []
    assert found["robot"] == ("arm4" if arm else "quadrotor")
    assert found["chosen"] == ("gp" if arm else "identified")
    assert 0.0 < found["forecast_fraction"] < 0.2
    assert len(found["outputs"]) == 4
    keys = {note.split(" ")[0] for note in old.notes}
    assert "model.kind" in keys
    assert len(old.notes) == len(keys)


def test_the_open_proposal_is_presented_and_certified_again(old: Campaign) -> None:
    before = {path: path.read_bytes() for path in old.path.glob("proposals/*/trajectory.json")}
    proposal = ask(old)
    assert (proposal.number, proposal.new) == (old.state().proposals[0].number, False)
    assert proposal.certificate.ok
    assert {path: path.read_bytes() for path in old.path.glob("proposals/*/trajectory.json")} == before
    # what is shown stands on the disk too; its old one held other limits
    shown = json.loads(proposal.certificate.to_json())
    assert json.loads((proposal.folder / "certificate.json").read_text()).items() >= shown.items()
    assert "an earlier version wrote them" in proposal.renewed[0]
    assert ask(old).renewed == ()


def test_its_model_is_trained_again_with_one_sentence(old: Campaign) -> None:
    number, before = old.state().trained[-1].number, old.state().trained[-1].trained
    assert before is not None
    with pytest.raises(DataError):
        newest_model(old, old.state())
    said: list[str] = []
    ask(old, say=said.append)
    assert said.count(AGAIN) == 1
    after = old.state().trained[-1].trained
    assert after is not None
    assert old.state().trained[-1].number == number
    assert (after["models"], after["logs"]) == (before["models"], before["logs"])
    assert after["predicted_by"] == before["predicted_by"]
    deviations = [np.array(facts["forecast_deviation"]) for facts in (before, after)]
    np.testing.assert_array_less(deviations[1], 3.0 * deviations[0])
    ask(old, say=said.append)
    assert said.count(AGAIN) == 1
    assert len(load_model(old.path).commands) == 4
    assert status(old)["problems"] == []


def test_the_log_of_its_open_proposal_is_told_and_the_next_is_designed(old: Campaign) -> None:
    number = old.state().proposals[0].number
    told = tell(old, FIXTURES / LOGS[old.kind.name])
    assert (told.number, told.foreign, told.learned) == (number, False, (number,))
    facts = old.state().trained[-1].trained
    assert facts is not None
    assert facts["logs"] == list(range(1, number + 1))
    assert "linear" in facts["models"]
    assert "gp" in facts["models"]
    proposal = ask(old, go_on=True)
    assert (proposal.number, proposal.new) == (number + 1, True)
    assert old.state().rounds[number + 1].asked["gain"] > 0.0  # type: ignore[index]
    events = [event.event for event in old.events()][-4:]
    assert events == ["told", "trained", "trained", "asked"]


def test_it_can_be_simulated_further(old: Campaign) -> None:
    trained = len(old.state().trained)
    (done,) = simulate(old, 1)
    assert len(old.state().trained) == trained + 1
    assert done.number == trained + 1
