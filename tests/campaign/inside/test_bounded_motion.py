"""The motion that a model is exported along, the newest proposal or a file, and limits that hold for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_robot import make_campaign, random_motion, stub_learner

from etude import ask
from etude.campaign.deployment.model_export import bounded_motion
from etude.errors import UsageError
from etude.limits import certify


def test_the_newest_proposal_or_a_file(tmp_path: Path) -> None:
    lab = make_campaign(tmp_path)
    with pytest.raises(UsageError, match="there is no proposal yet"):
        bounded_motion(lab, None)
    own = random_motion(lab, 3)
    (tmp_path / "own.json").write_text(own.to_json())
    found = bounded_motion(lab, tmp_path / "own.json")
    t = np.linspace(0.0, own.duration, 7)
    np.testing.assert_array_equal(found.trajectory.motion(t, 3).orders, own.motion(t, 3).orders)
    t = np.linspace(0.0, own.duration, 101)
    places = own.motion(t, 1).orders[0]
    header = ",".join(["t", *(f"q_{name}" for name in lab.axes)])
    np.savetxt(tmp_path / "own.csv", np.column_stack([t, places]), delimiter=",", header=header, comments="")
    found = bounded_motion(lab, tmp_path / "own.csv")
    assert np.abs(found.trajectory.motion(t, 1).orders[0] - places).max() < 0.01 * np.ptp(places)
    proposal = ask(lab, learner=stub_learner)
    found = bounded_motion(lab, None)
    assert found.trajectory.duration == proposal.duration
    assert certify(found.trajectory, found.limits).ok
    path = proposal.folder / "trajectory.json"
    path.write_text(path.read_text().replace("0.1", "0.2"))
    with pytest.raises(UsageError, match=r"trajectory.json was changed"):
        bounded_motion(lab, None)
    with pytest.raises(UsageError, match="there is no such motion"):
        bounded_motion(lab, tmp_path / "none.json")
