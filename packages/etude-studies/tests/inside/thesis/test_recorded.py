"""Tables of models on a recorded log: what is left out, what is refused."""

from __future__ import annotations

import pytest

from etude.errors import UsageError
from etude_studies.real_logs import EXAMPLES
from etude_studies.thesis.choosing import ledger
from etude_studies.thesis.recorded import Recorded, claims_of_log, entry_of_log, runs_on_logs
from etude_studies.world import World

UR10 = EXAMPLES / "ur10" / "ur10_exciting.csv"


def test_a_fold_is_learned_piece_by_piece_and_judged_on_what_was_left_out() -> None:
    results = Recorded.of(UR10, None, 2).results(["A0"])
    assert results.seeds("A0") == (0, 1)
    joints = World.of(UR10.with_name("ur10.toml")).spec.names
    first, last = (results.values("A0:linear", "error", k, "fourier") for k in (1, 6))
    assert all(0.0 < last[fold] < first[fold] for fold in (0, 1))
    own = [results.values("A0", "error", 6, "fourier", joint) for joint in joints]
    whole = results.values("A0", "error", 6, "fourier")
    assert whole[0] == pytest.approx(sum(by[0] for by in own) / len(joints), rel=1e-5)
    assert whole[0] != whole[1]


def test_tables_of_models_have_their_runs_and_claims() -> None:
    entry = ledger().entry("table-6.9")
    assert runs_on_logs(entry) == ["A6", "A5", "A1"]
    assert [claim.id for claim in claims_of_log(ledger(), ["A6", "A5", "A1"], 7)] == ["C6.2-2", "C6.2-3"]
    assert {claim.seeds for claim in claims_of_log(ledger(), ["A1", "A5"], 7)} == {7}
    shown = entry_of_log(entry, World.of(UR10.with_name("ur10.toml")))
    assert shown.columns[-1] == "mean"
    assert not any(row.printed for row in shown.rows)


@pytest.mark.parametrize("id", ["table-6.10", "table-6.2", "figure-5.1"])
def test_what_no_log_can_answer_is_refused(id: str) -> None:
    with pytest.raises(UsageError, match="does not compare models on given data"):
        runs_on_logs(ledger().entry(id))


def test_folds_and_robots_that_cannot_be_are_refused() -> None:
    with pytest.raises(UsageError, match="1 folds cannot be left out"):
        Recorded.of(UR10, None, 1)
    with pytest.raises(UsageError, match="these tables are of arms"):
        Recorded.of(UR10, EXAMPLES / "crazyflie" / "crazyflie.toml", 4)
