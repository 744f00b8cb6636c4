"""Folds of SARCOS's training part, and the sentence where it is not there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etude.errors import UsageError
from etude_studies.real_fit_points import EVERY, fit_rows, folds
from etude_studies.real_logs import REAL_LOGS


def test_every_sample_is_left_out_once_and_never_teaches_then() -> None:
    (tx40,) = (real for real in REAL_LOGS if real.name == "tx40")
    train = tx40.load(tx40.find()).train
    left_out = []
    for teaching, held in folds(train):
        assert not {*teaching.t} & {*held.t}
        assert len(teaching) + len(held) == len(train)
        left_out += [*held.t]
    assert sorted(left_out) == sorted(train.t)
    assert np.diff([len(held) for _, held in folds(train)]).max() <= len(train) // EVERY // 4


def test_a_folder_without_it(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="SARCOS is not there"):
        fit_rows(tmp_path)
