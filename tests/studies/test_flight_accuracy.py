"""The study of inverse models flies, learns and scores; its figures are measured elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.studies.flight_accuracy import flight_accuracy


def test_rows_of_one_seed_are_finite_and_named() -> None:
    rows = {row.metric: row for row in flight_accuracy("quadrotor", "default", (2,), (7,), tests=2)}
    for kind in ("nominal", "identified", "identified_no_trims", "gp", "identified+gp", "ladder"):
        assert np.isfinite(rows[f"mae_{kind}_2"].value)
        assert np.isfinite(rows[f"z2_{kind}_2"].value)
    assert rows["mae_identified_2"].value < 0.6 * rows["mae_nominal_2"].value
    assert rows["mae_identified_2"].reference_value == rows["mae_nominal_2"].value


def test_an_unknown_setting_is_refused() -> None:
    with pytest.raises(UsageError, match="no setting"):
        flight_accuracy("quadrotor", "windy")
