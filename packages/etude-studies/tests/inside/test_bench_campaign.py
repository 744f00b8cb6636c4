"""`etude bench campaign`: its rows, with commands that cost nothing, and its chains of hinges."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from etude.campaign import create_campaign, open_campaign
from etude_studies import bench_campaign
from etude_studies.bench_campaign import AT, JOINTS, LOGS, Cost, chain, measured, run


def test_every_number_of_logs_and_joints_has_its_rows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[tuple[str, int]] = []

    def free(word: str, folder: str, *logs: str) -> Cost:
        asked.append((word, len(logs)))
        return Cost(1.5, 200.0)

    monkeypatch.setattr(bench_campaign, "measured", free)
    monkeypatch.setattr(
        bench_campaign, "logs_of", lambda folder, robot, count, seed: [folder / "log"] * count
    )
    rows = run(json=True)
    names = {f"arm4_rough_logs{n}" for n in LOGS} | {f"chain{n}_logs{AT}" for n in JOINTS}
    assert {row.metric for row in rows} == {
        f"{word}_{name}{end}" for word in ("tell", "ask") for name in names for end in ("", "_memory")
    }
    assert ("tell", max(LOGS) - 1) in asked, "all others are ingested before"
    assert asked.count(("tell", 1)) >= len(names), "the last by itself"
    assert len(json.loads(capsys.readouterr().out)["rows"]) == len(rows)


@pytest.mark.parametrize("joints", [2, 7])
def test_chains_are_robots(joints: int, tmp_path: Path) -> None:
    urdf = tmp_path / "chain.urdf"
    urdf.write_text(chain(joints))
    create_campaign(tmp_path / "lab", str(urdf))
    campaign = open_campaign(tmp_path / "lab")
    assert len(campaign.axes) == joints
    assert campaign.kind.robot(campaign.spec, campaign.config) is not None


def test_a_command_is_measured_in_its_own_process() -> None:
    found = measured("--version")
    assert found.seconds > 0.0
    assert 10.0 < found.memory < 1000.0
