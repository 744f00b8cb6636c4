"""Odds of decisions over drawn arms: a few of them, and how ends are counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etude.campaign import judged_commands
from etude_studies.bench_odds import Verdict, drawn_arm, driven, end, kept, odds_rows, other_masses
from etude_studies.seven_joints import described

SIGN = Verdict(
    "arm", False, "sign", (1.0, -1.0), "ask", "sign", (1.0, -1.0), 9.0, 9.0, True, (8.0, -4.0), 0.1
)


def changed(**what: object) -> Verdict:
    return Verdict(**{name: getattr(SIGN, name) for name in SIGN.__struct_fields__} | what)  # type: ignore[arg-type]


@pytest.mark.parametrize("number", [50_002, 50_007])
def test_a_drawn_arm_is_right_and_its_fault_is_repaired(number: int, tmp_path: Path) -> None:
    right, wrong = kept(number, tmp_path)
    assert (right.fault, right.level) == ("", "silent")
    assert end(wrong) == "repaired"
    assert min(right.told) > 20.0
    path = tmp_path / f"{number}.json"
    path.write_bytes(path.read_bytes().replace(b'"silent"', b'"ask"'))
    assert kept(number, tmp_path)[0].level == "ask", "what was judged is not judged again"


@pytest.mark.parametrize(
    ("number", "question"),
    [(324, "scale"), (349, "delay"), pytest.param(70_174, "scale", marks=pytest.mark.slow)],
)
def test_right_arms_whose_friction_resembles_a_fault_are_not_asked_about(number: int, question: str) -> None:
    """Links of any masses fit what friction leaves at 27 and 61 times the file. A joint that often turns
    round may be early or late alike.
    """
    rng = np.random.default_rng([number, 31])
    built = drawn_arm(rng)
    log = driven(built, rng)
    world = described(0.0, other_masses(built, rng))
    findings = judged_commands(world.kind, world.spec, log)
    assert [f.sentence for f in findings if f.flag] == [], question


@pytest.mark.parametrize("number", [50_410, pytest.param(50_540, marks=pytest.mark.slow)])
def test_an_exchanged_pair_that_resembles_inverted_signs_is_not_repaired(number: int, tmp_path: Path) -> None:
    _, wrong = kept(number, tmp_path)
    assert (wrong.fault, wrong.check) == ("swapped", "sign")
    assert end(wrong) == "asked_of_others"


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ({}, "repaired"),
        ({"by": (-1.0, -1.0)}, "repaired_wrong"),
        ({"check": "direction"}, "repaired_wrong"),
        ({"offered": False}, "asked"),
        ({"offered": False, "by": (-1.0, 1.0)}, "asked_of_others"),
        ({"level": "silent", "check": "", "by": ()}, "silent"),
        ({"fault": "swapped", "check": "swapped", "truth": (1.0, 0.0), "by": (1.0, 0.0)}, "repaired"),
    ],
)
def test_ends(what: dict[str, object], expected: str) -> None:
    assert end(changed(**what)) == expected


def test_rows_count_right_logs_ends_and_signs_by_stated_odds() -> None:
    found = [changed(fault="", level="certain"), changed(fault="", level="silent"), SIGN]
    rows = {row.metric: (row.value, row.reference_value) for row in odds_rows(found)}
    assert rows["right_refused"] == (1, 2)
    assert rows["right_asked"] == (0, 2)
    assert rows["sign_repaired"] == (1, 1)
    assert rows["wrong_signs_stated_3"] == (3, 3)
    assert rows["wrong_signs_stated_7"] == (0, 3)
