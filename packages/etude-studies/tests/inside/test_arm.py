"""The study of the arms: every cell is an ordinary campaign, and a finished one costs nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from etude.campaign import Evaluated, load_config, open_campaign
from etude.errors import UsageError
from etude_studies import arm
from etude_studies.arm import ARMS, Cell
from etude_studies.arm_rows import arm_rows


def test_a_cell_is_a_campaign_with_its_rung_and_goes_on_where_it_was(monkeypatch, tmp_path: Path) -> None:
    asked = []
    monkeypatch.setattr(arm, "simulate", lambda campaign, rounds, **_: asked.append(rounds) or iter(()))
    cell = Cell("arm4", "identified+gp", 3)
    assert arm.run_one(cell, tmp_path) == arm.run_one(cell, tmp_path) == cell
    assert asked == [arm.ROUNDS, arm.ROUNDS]
    config = load_config(tmp_path / cell.name).config
    assert (config.model.rung, config.seed, config.preset) == ("identified+gp", 3, "default")
    assert len(open_campaign(tmp_path / cell.name).events()) == 1


def test_rows_are_means_over_campaigns_beside_the_perfect_model(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(arm, "simulate", lambda *_, **__: iter(()))
    cells = [arm.run_one(Cell("arm4", "gp", seed), tmp_path) for seed in (0, 1)]
    for cell in cells:
        campaign = open_campaign(tmp_path / cell.name)
        for baseline, error in (("perfect", 0.1), ("pd", 3.0 + cell.seed)):
            with campaign.writing():
                run = Evaluated(test="fourier", baseline=baseline, errors=(error,) * 4, unit="deg")
                campaign.commit(run, 0)
    rows = {row.metric: row for row in arm_rows(tmp_path, cells)}
    assert set(rows) == {"arm4_gp_fourier_pd", "arm4_gp_fourier_pd_ci95"}
    assert rows["arm4_gp_fourier_pd"].value == pytest.approx(3.5)
    assert rows["arm4_gp_fourier_pd"].reference_value == pytest.approx(0.1)


def test_one_seed_has_no_interval_and_every_arm_is_there() -> None:
    with pytest.raises(UsageError, match="2 seeds"):
        arm.run(json=True, seed=0, seeds=1, folder=Path("nowhere"))
    assert len({Cell(*place, 0).name for place in ARMS}) == 4
