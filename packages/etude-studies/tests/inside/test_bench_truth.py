"""The truth table: a few logs every day, all of them when asked."""

from __future__ import annotations

from pathlib import Path

import pytest

from etude.types import Finding
from etude_studies.bench_truth import ENDS, Ended, ending, judged, kept, truth_rows
from etude_studies.truth_logs import Source, real_sources, simulated_sources
from etude_studies.truth_wrong import Wrong

LOG = Wrong("sign", "sign", lambda log: log, 0)


def source(name: str) -> Source:
    return next(s for s in real_sources(None) if s.key == name)


def told(ended: Ended) -> tuple[int, int]:
    """How many were told, and told right."""
    ends = [own for counts in ended.counts.values() for own in counts.items()]
    right = sum(n for end, n in ends if end == "right")
    return sum(n for end, n in ends if end in ("right", "wrong")), right


def test_a_real_log_with_velocities_is_told_wrong_in_every_way() -> None:
    found = judged(source("ur10_velocities"))
    assert found.flagged == {}
    assert found.counts == {
        "sign": {"right": 6},
        "swapped": {"right": 15},
        "degrees": {"right": 3},
        "x2": {"right": 2},
        "x60": {"right": 2},
        "reversed": {"right": 1},
        "jump": {"right": 6},
        **{key: {"right": 1} for key in ("held_commands", "unsigned", "off", "copied", "turns", "overflow")},
        **{key: {"right": 3} for key in ("held", "lost")},
    }
    assert set(found.sentences) == set(found.counts)


@pytest.mark.parametrize("number", [0, 4])
def test_simulated_logs_without_velocities(number: int) -> None:
    found = judged(simulated_sources(5, 0)[number])
    assert found.flagged == {}
    all_, right = told(found)
    assert right == all_ > 0
    assert found.counts["x2"] == {"cannot tell": 2}
    assert set(found.counts["jump"]) == {"right"}


def test_a_judged_log_is_not_judged_again(tmp_path: Path) -> None:
    own = source("crazyflie_log16_yaw_second")
    first = kept(own, tmp_path)
    path = tmp_path / f"{own.key}.json"
    path.write_bytes(path.read_bytes().replace(b'"right":1', b'"right":7'))
    assert kept(own, tmp_path) != first


@pytest.mark.parametrize(
    ("found", "end"),
    [
        ([], "cannot tell"),
        ([Finding("sign", "green", "All is right.")], "missed"),
        ([Finding("sign", "cannot tell", "Nothing tells.")], "cannot tell"),
        ([Finding("swapped", "yellow", "Swapped.", flag="swapped")], "wrong"),
        ([Finding("refused", "red", "Out of range.")], "refused"),
    ],
)
def test_the_ends(found: list[Finding], end: str) -> None:
    assert ending(LOG, found, [])[0] == end


def test_what_the_right_log_shows_is_no_detection() -> None:
    alarm = Finding("sign", "yellow", "Inverted.", flag="sign")
    assert ending(LOG, [alarm], [alarm])[0] != "wrong"


def test_rows_count_by_robot_and_end() -> None:
    sources = simulated_sources(10, 0)
    one = Ended({"sign": {"right": 3, "missed": 1}}, {"sign": "Inverted."}, {}, [])
    rows = {row.metric: row for row in truth_rows(dict.fromkeys(sources, one))}
    assert rows["arm4_sign_right"].value == 6
    assert rows["arm4_sign_right"].reference_value == 8
    assert rows["arm4_velocities_right_logs_suspected"].value == 2
    assert {m.removeprefix("arm4_sign_") for m in rows if m.startswith("arm4_sign_")} == {
        end.replace(" ", "_") for end in ENDS
    }


@pytest.mark.slow
def test_of_those_told_99_percent_are_told_right(tmp_path: Path) -> None:
    found = {s: kept(s, tmp_path) for s in (*real_sources(None), *simulated_sources(200, 0))}
    total, right = (sum(told(ended)[i] for ended in found.values()) for i in (0, 1))
    assert right >= 0.99 * total
    suspected = {s.key: ended.flagged for s, ended in found.items() if ended.flagged}
    assert set(suspected) == {"tiago"}
    assert set(suspected["tiago"]) == {"sign"}
