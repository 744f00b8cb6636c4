"""ask --from: what cannot be proved leaves nothing behind, and flights can be flown from the ground."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small_robot import make_campaign

from etude.campaign import open_campaign, there_and_back
from etude.cli import main
from etude.limits import FeasibleSet, boundary, certify, scaled
from etude_quadrotor import KIND, FlightConfig, flight_family

RANDOM = '[trajectory]\nduration = 12.0\n[data]\ncutoff_hz = 5.0\n[design]\nfirst = "random"\n'
EDGE = "hip=1.0,knee=0.0"
"""Inside the limits, outside of what is left of them beside the margin of tracking."""


@pytest.mark.parametrize("name", ["quadrotor", pytest.param("quadrotor_rough", marks=pytest.mark.slow)])
def test_each_flight_in_motion_at_its_ends_is_reached_from_the_ground(name: str) -> None:
    """3 of 10 were refused for their tilt in the approach, which one septic made."""
    spec, config = KIND.spec(KIND.built_in()[name]), FlightConfig(2, 15.0, tilt=0.4363)
    allowed, family = KIND.limits(spec, SimpleNamespace(trajectory=config), None, {}), flight_family(config)
    room = FeasibleSet.of(allowed, family, KIND.home(spec))
    for seed in range(20):
        draw = scaled if seed % 2 else boundary
        flight = family.trajectory(draw(np.random.default_rng([4, seed]), room)[0])
        ground = KIND.poses(spec)["ground"]
        found = there_and_back(
            flight, ground, lambda m, p: KIND.approaches(spec, m, p), allowed, KIND.home(spec)
        )
        assert found is not None
        assert found.whole is not None
        assert certify(found.whole, allowed).ok
        assert certify(found.whole, allowed).at_rest


def test_a_new_motion_that_no_way_leads_to_is_not_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(make_campaign(tmp_path, config=RANDOM).path)
    before = sorted(path.relative_to(folder) for path in Path(folder).rglob("*"))
    assert main(["ask", folder, "--from", EDGE]) == 4
    assert "No trajectory was written" in capsys.readouterr().err
    assert sorted(path.relative_to(folder) for path in Path(folder).rglob("*")) == before
    assert main(["ask", folder]) == 0, "the advice: ask without --from"
    assert main(["ask", folder, "--from", "home"]) == 0


def test_an_open_motion_that_no_way_leads_to_stays_and_blocks_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign = make_campaign(tmp_path, config=RANDOM)
    folder = str(campaign.path)
    assert main(["ask", folder]) == 0
    capsys.readouterr()
    assert main(["ask", folder, "--from", EDGE]) == 4
    said = capsys.readouterr().err
    assert "The pose itself is the problem" in said
    assert "proposal 1 stays open" in said
    assert "etude abandon" not in said, "from there no other motion can begin either"
    assert not list(campaign.proposal(1).glob("from_*"))
    assert main(["ask", folder]) == 0, "it is shown still"
    assert main(["abandon", folder, "1"]) == 0
    assert main(["ask", folder, "--from", "home"]) == 0
    assert [r.number for r in open_campaign(campaign.path).state().proposals] == [2]
