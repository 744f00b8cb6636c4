"""Learning curves of the rough arm: what is kept is not simulated again, and how rows are made of curves."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from etude_studies.bench_learning import Curve, kept, learning_rows


def curve(fourier: float, moves: float) -> Curve:
    return Curve({"fourier": [0.5, fourier], "moves": [0.4, moves]}, 360.0, 80.0)


def test_a_campaign_that_is_kept_is_not_simulated_again(tmp_path: Path) -> None:
    (tmp_path / "default_201.json").write_bytes(msgspec.json.encode(curve(0.1, 0.2)))
    assert kept(("default", 201), tmp_path, 2) == curve(0.1, 0.2)


def test_rows_are_means_after_the_last_motion_and_paired_differences() -> None:
    found = {"default": [curve(0.1, 0.2), curve(0.2, 0.1)], "other": [curve(0.1, 0.3), curve(0.1, 0.2)]}
    rows = {row.metric: row for row in learning_rows(found)}
    assert rows["default_fourier"].value == pytest.approx(0.15)
    assert rows["default_moves"].reference_value == pytest.approx(0.15)
    assert rows["other_fourier_more"].value == pytest.approx(-0.05)
    assert rows["other_moves_more"].value == pytest.approx(0.1)
    assert rows["other_moves_more_ci95"].value == pytest.approx(0.0, abs=1e-12)
    assert rows["robot_time"].value == pytest.approx(6.0)
    assert "default_moves_more" not in rows
