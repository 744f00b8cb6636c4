"""`etude run` with vehicles behind mocks: exit codes tell a vehicle that stopped from a lost link."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from etude.cli import main
from etude.drivers import Stream

ROBOT = """\
kind = "quadrotor"
name = "vehicle"
commands = ["m1", "m2", "m3", "m4"]
command_unit = "1"
command_lower = [0.0, 0.0, 0.0, 0.0]
command_upper = [1.0, 1.0, 1.0, 1.0]
rate = 25.0
lower = [-14.0, -14.0, 0.0]
upper = [14.0, 14.0, 6.0]
speed = 8.0
margin = 1.0
vertical_margin = 0.3
"""
QUICK = {"candidates = 100": "candidates = 20", "steps = 60": "steps = 15", "starts = 3": "starts = 1"}
FLIES_S = 5.0
"""After which the fault comes."""


def px4(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> Stream:
    """address: "pilot" takes over, or it falls "silent"."""
    from px4_stand_in import OFFBOARD, POSITION, StandIn, Wire

    from etude_drivers import Px4Vehicle

    class Struck(StandIn):
        def step(self, seconds: float) -> bytes:
            if self.mode == OFFBOARD and self.now > 12.0 + FLIES_S:
                self.silent = address == "silent"
                self.mode = self.mode if self.silent else POSITION
            return super().step(seconds)

    return Px4Vehicle(joints, "mock", settings, lambda _: Wire(Struck()), virtual=True)


def crazyflie(joints: tuple[str, ...], address: str, settings: Mapping[str, Any]) -> Stream:
    """address: it has "crashed", or falls "silent"."""
    from crazyflie_stand_in import StandIn, address_of

    from etude_drivers import CrazyflieVehicle

    class Struck(StandIn):
        def step(self, seconds: float) -> list[bytes]:
            if self.now > 16777.0 + FLIES_S:
                self.silent, self.locked = address == "silent", address == "crashed"
            return super().step(seconds)

    return CrazyflieVehicle(joints, address_of(Struck()), settings, virtual=True)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("vehicles")
    (folder / "vehicle.toml").write_text(ROBOT)
    assert main(["init", str(folder / "lab"), "--robot", str(folder / "vehicle.toml")]) == 0
    config = folder / "lab" / "campaign.toml"
    text = config.read_text()
    for slow, quick in QUICK.items():
        assert slow in text
        text = text.replace(slow, quick)
    config.write_text(text)
    assert main(["ask", str(folder / "lab")]) == 0
    return folder / "lab"


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("library", "on", "code", "says"),
    [
        ("pymavlink", "px4:pilot", 7, "a pilot or a failsafe has taken over"),
        ("pymavlink", "px4:silent", 8, "no sample for 0.3 s"),
        ("cflib", "crazyflie:crashed", 7, "the firmware has stopped the rotors"),
        ("cflib", "crazyflie:silent", 8, "no sample for 0.25 s"),
    ],
)
def test_exit_codes(
    lab: Path, tmp_path: Path, library: str, on: str, code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip(library, reason=f"the driver needs {library}")
    own = shutil.copytree(lab, tmp_path / "lab")
    assert main(["run", str(own), "--on", f"{__file__}:{on}", "--rounds", "1", "--yes"]) == code
    assert says in capsys.readouterr().err
    ended = json.loads((own / "journal.jsonl").read_text().splitlines()[-1])
    assert (ended["event"], ended["exit_code"]) == ("run_ended", code)


def test_a_dry_run_draws_a_vehicles_way_too(lab: Path, tmp_path: Path) -> None:
    pytest.importorskip("pymavlink", reason="the driver px4 needs pymavlink")
    own = shutil.copytree(lab, tmp_path / "lab")
    assert main(["run", str(own), "--on", f"{__file__}:px4:", "--dry-run"]) == 0
    page = (own / "view.html").read_text()
    assert "with the approach from the current pose" in page
    assert page.count('"label":"approach"') >= 1
