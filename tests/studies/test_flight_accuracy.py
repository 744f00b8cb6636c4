"""The study of inverse models flies, learns and scores; its figures are measured elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude_studies.flight_accuracy import flight_accuracy


def test_rows_of_one_seed_are_finite_and_named() -> None:
    rows = {row.metric: row for row in flight_accuracy("quadrotor", "default", (1,), (7,), tests=1)}
    for kind in ("nominal", "identified", "identified_no_trims", "gp", "identified+gp", "ladder"):
        assert np.isfinite(rows[f"mae_{kind}_1"].value)
        assert np.isfinite(rows[f"z2_{kind}_1"].value)
    assert rows["mae_ladder_1"].value in (rows["mae_identified_1"].value, rows["mae_nominal_1"].value)
    assert rows["mae_identified_1"].reference_value == rows["mae_nominal_1"].value


def test_an_unknown_setting_is_refused() -> None:
    with pytest.raises(UsageError, match="no setting"):
        flight_accuracy("quadrotor", "windy")
