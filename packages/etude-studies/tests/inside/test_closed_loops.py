"""Closed loops with margins: which rows are run, what the table says, and, slowly, that limits are kept."""

from __future__ import annotations

import numpy as np
import pytest

from etude.trajectories import PointToPoint
from etude_arm import PerfectController
from etude_studies.closed_loops import CONTROLS, FORMS, ROBOTS, ROWS, RUNS, Case, cases, run_row, summary
from etude_studies.seven_loop import seven_loop


def test_a_thousand_loops_have_margins() -> None:
    rows = cases(ROWS)
    with_margins = [case for case in rows if case.margin]
    assert RUNS * len(with_margins) >= 1000
    kinds = {(case.robot, case.control, case.form) for case in with_margins}
    assert len(kinds) == len(ROBOTS) * len(CONTROLS) * len(FORMS)
    assert len({case.seed for case in rows}) == ROWS


def test_the_table_counts_what_is_outside_and_what_was_covered() -> None:
    def run(number: int, position: float, velocity: float, covered: bool) -> dict[str, object]:
        return {"logs": number, "outside": [position, velocity], "covered": [True, covered]}

    runs = [run(0, -0.1, 0.2, False), run(1, -0.1, -0.1, True), run(2, 0.1, 0.1, False)]
    lines = summary([{"robot": "arm4", "margin": True, "runs": runs}]).splitlines()
    assert lines[1].split()[-6:] == ["1", "0.0", "100.0", "100.0", "100.0", "0.0"]
    assert lines[2].split()[-6:] == ["2", "50.0", "50.0", "50.0", "100.0", "50.0"]
    assert len(lines) == 5


def test_the_arm_of_seven_joints_follows_better_with_its_exact_inverse() -> None:
    arm, rng = seven_loop(), np.random.default_rng(4)
    middle, size = 0.5 * (arm.spec.upper + arm.spec.lower), 0.2 * (arm.spec.upper - arm.spec.lower)
    motion = PointToPoint(np.stack([middle, middle + size]), arm.spec.velocity, 0.1, arm.spec.acceleration)
    errors = []
    for controller in (None, PerfectController(arm)):
        log = arm.run(motion, controller, rng)
        planned = motion.motion(np.maximum(log.t, 0.0), 1).orders[0]
        errors.append(np.abs(log["q_true"] - planned)[log.t > 0.0].max())
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_a_row_with_margins_keeps_its_limits_once_it_has_a_log(form: str) -> None:
    """Of any row the first run of a control may leave a velocity limit: its margin is assumed."""
    found = run_row(Case("arm4_rough", form, "feedforward", True, 3))
    assert [run["logs"] for run in found] == [0, *range(RUNS - 1)]
    assert max(max(run["outside"]) for run in found if run["logs"]) <= 0.0
    assert max(run["outside"][0] for run in found) <= 0.0
    assert np.mean([all(run["covered"]) for run in found if run["logs"]]) > 0.8
    bare = run_row(Case("arm4_rough", form, "feedback", False, 3))
    assert max(max(run["outside"]) for run in bare) > 0.0
