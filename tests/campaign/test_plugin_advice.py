"""Plug-ins that something cannot use: they are named, the rest works, and the printed step does."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from small_robot import SHORT, make_campaign, write_log

from etude import ask, cli, plugins
from etude.campaign import Campaign, stored_trajectory

pytestmark = pytest.mark.as_logged

KERNELS = """
from etude.models import SquaredExponential

class Foreign(SquaredExponential):
    "Of somebody who wrote no C and no operators."

def bump(columns, commands):
    return Foreign(tuple(range(len(columns))))
"""
MODEL = (
    SHORT + '[model]\nkernel = "bumps:bump"\nprocess = "exact"\nrung = "gp"\npoints = 60\nfit_points = 40\n'
)
SETTING = re.compile(r'(\w+) = ("\w+"|\[.*?\])')


@pytest.fixture
def learned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """A folder that has learned one log with a plug-in's kernel, and the log."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setattr(plugins, "_typed_names", set())
    (tmp_path / "bumps.py").write_text(KERNELS)
    monkeypatch.syspath_prepend(str(tmp_path))
    campaign = make_campaign(tmp_path, config=MODEL)
    log = write_log(tmp_path / "run.csv", stored_trajectory(campaign, ask(campaign).number))
    assert cli.main(["tell", str(campaign.path), str(log), "--trust"]) == 0
    return campaign.path, log


@pytest.mark.parametrize("target", ["c", "onnx"])
def test_a_model_that_cannot_leave_says_what_to_do_and_that_works(
    learned: tuple[Path, Path], target: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, log = learned
    assert cli.main(["export", str(folder), "--to", target]) != 0
    said = " ".join(capsys.readouterr().err.split())
    assert "kernel 'bumps:bump' cannot be exported" in said
    config = (folder / "campaign.toml").read_text()
    for name, value in SETTING.findall(said.partition("In [model]")[2]):
        old = re.compile(rf"^{name} = .*\n", re.MULTILINE)
        config = old.sub("", config.replace("candidates = 4", "CANDIDATES = 4"))
        config = config.replace("[model]\n", f"[model]\n{name} = {value}\n").replace(
            "CANDIDATES", "candidates"
        )
    (folder / "campaign.toml").write_text(config)
    assert "etude untell FOLDER NUMBER, etude tell FOLDER LOG" in said
    assert cli.main(["untell", str(folder), "1"]) == 0
    assert cli.main(["tell", str(folder), str(log)]) == 0
    assert cli.main(["export", str(folder), "--to", target]) == 0


@pytest.fixture
def without_lagrangian(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half an installation: none of the modules of etude_lagrangian can be imported."""
    for name in ("kernel", "member"):
        monkeypatch.setitem(sys.modules, f"etude_lagrangian.{name}", None)
    monkeypatch.setattr(plugins, "_failures", {})


@pytest.mark.usefixtures("without_lagrangian")
def test_a_broken_package_beside_takes_its_own_candidates_and_no_more(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = '[model]\nrung = "gp"\npoints = 60\nfit_points = 40\nstretch_s = 4.0\n'
    campaign = make_campaign(tmp_path, config=SHORT + config)
    log = write_log(tmp_path / "run.csv", stored_trajectory(campaign, ask(campaign).number))
    assert cli.main(["tell", str(campaign.path), str(log)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Learned: 1." in said
    assert "The candidate gip_lin is not used: the kernel 'gip_lin' cannot be loaded" in said
    cli.main(["plugins"])
    listed = " ".join(capsys.readouterr().out.split())
    assert "(!) gip_lin of etude.kernels" in listed
    assert "(!) structured" not in listed


def test_status_shows_what_it_can_where_a_package_is_missing(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setattr(plugins, "_typed_names", set())
    with (campaign.path / "robot.toml").open("a") as file:
        file.write('\n[[limit]]\nkind = "nowhere:plane"\n')
    assert cli.main(["status", str(campaign.path), "--trust"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    before, shown, after = said.partition("More cannot be shown:")
    assert shown
    assert f"{campaign.name} ({', '.join(campaign.axes)})" in before
    assert "No module named 'nowhere'" in after
