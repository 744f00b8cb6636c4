"""`etude learn`: campaigns learned anew, and what cannot be learned harms no other."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from small_robot import SHORT, make_campaign, random_motion, write_log

from etude import cli, tell
from etude.campaign import Campaign
from etude.storage import sha256_of

LINEAR = f'{SHORT}[model]\nrung = "linear"\ncandidates = ["default"]\n'
pytestmark = pytest.mark.as_logged
Learn = Callable[..., tuple[int, list[dict[str, Any]]]]


@pytest.fixture
def lab(tmp_path: Path) -> Campaign:
    campaign = make_campaign(tmp_path, config=LINEAR)
    tell(campaign, write_log(tmp_path / "log.csv", random_motion(campaign, 1)), foreign=True)
    return campaign


@pytest.fixture
def learn(capsys: pytest.CaptureFixture[str]) -> Learn:
    """The command: its exit code, and what became of each campaign."""

    def learn(*words: object) -> tuple[int, list[dict[str, Any]]]:
        capsys.readouterr()
        code = cli.main(["learn", *map(str, words), "--json"])
        return code, json.loads(capsys.readouterr().out)["campaigns"]

    return learn


def test_the_model_follows_campaign_toml(lab: Campaign, learn: Learn) -> None:
    model = lab.model_folder(1) / "model.npz"
    before = sha256_of(model)
    assert learn(lab.path)[0] == 0
    assert sha256_of(model) == before
    path = lab.path / "campaign.toml"
    path.write_text(path.read_text().replace('"linear"', '"gp"'))
    code, (found,) = learn(lab.path)
    assert (code, found["logs"], found["structure"]) == (0, [1], "gp")
    assert sha256_of(model) != before


def test_what_cannot_be_learned_harms_no_other(lab: Campaign, tmp_path: Path, learn: Learn) -> None:
    broken, empty = make_campaign(tmp_path / "broken", config=LINEAR), make_campaign(tmp_path / "empty")
    tell(broken, write_log(tmp_path / "other.csv", random_motion(broken, 2)), foreign=True)
    (broken.path / "runs" / "0001.parquet").unlink()
    code, found = learn(broken.path, empty.path, lab.path)
    assert code == 3
    assert [one["folder"] for one in found] == [str(own.path) for own in (broken, empty, lab)]
    assert "0001.parquet" in found[0]["problem"]
    assert (found[1]["logs"], found[1]["problem"]) == ([], "")
    assert (found[2]["logs"], found[2]["problem"]) == ([1], "")


def test_what_is_no_campaign_is_told_before_anything_is_learned(lab: Campaign, tmp_path: Path) -> None:
    before = (lab.path / "journal.jsonl").read_bytes()
    assert cli.main(["learn", str(lab.path), str(tmp_path / "none")]) == 2
    assert (lab.path / "journal.jsonl").read_bytes() == before


@pytest.mark.slow
def test_processes_and_a_cluster_learn_the_same(lab: Campaign, learn: Learn) -> None:
    """Slow: each process imports Étude, a cluster Dask too."""
    distributed = pytest.importorskip("distributed", reason="pip install ./packages/etude-studies")
    pytest.importorskip("etude_studies", reason="pip install ./packages/etude-studies")
    digest = sha256_of(lab.model_folder(1) / "model.npz")
    assert learn(lab.path, "--workers", 1)[0] == 0
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        assert learn(lab.path, "--cluster", cluster.scheduler_address)[0] == 0
    assert sha256_of(lab.model_folder(1) / "model.npz") == digest
    assert len([e for e in lab.events() if e.event == "trained"]) == 3
