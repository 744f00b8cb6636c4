"""Memory of what is found in logs: the same contents are judged once, others anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.types import Log
from judged_once import once


def test_equal_contents_are_judged_once_and_others_anew() -> None:
    calls = []

    def judge(logs: list[Log], *, fresh: object = None) -> int:
        calls.append(logs)
        return len(calls)

    remembered, log = once(judge), Log(np.arange(3.0), {}, {"q": np.zeros((3, 1))}, "a.csv")
    assert (
        remembered([log], fresh=range(1)) == remembered([replace(log, source="b.csv")], fresh=range(1)) == 1
    )
    assert remembered([log], fresh=range(2)) == 2
    assert remembered([replace(log, values={"q": np.full((3, 1), 1e-12)})], fresh=range(1)) == 3
    assert remembered([log], fresh=lambda: None) == 4  # it cannot be pickled
    assert remembered([log], fresh=lambda: None) == 5
