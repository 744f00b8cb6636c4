"""A run's name: the same for the same run, another for any other; and how a run is carried out."""

from __future__ import annotations

import pickle

import polars as pl
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from etude.errors import DataError, UsageError
from etude_studies.measured import Measured, measured_table
from etude_studies.spec import Spec, run_one, spec_of

ONE = Spec("engine_runs:noisy", {"rounds": 3, "rate": 0.1, "arm": {"b": [1, 2], "a": True}}, 7)
LEAVES = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
)
SETTINGS = st.dictionaries(
    st.text(), st.recursive(LEAVES, lambda own: st.lists(own) | st.dictionaries(st.text(), own), max_leaves=8)
)


def test_the_canonical_form_and_its_hash_are_pinned() -> None:
    """Committed results are found by it: whoever changes it makes all of them foreign."""
    assert ONE.canonical() == (
        '{"function":"engine_runs:noisy","needs":[],"seed":7,'
        '"settings":{"arm":{"a":true,"b":[1,2]},"rate":0.1,"rounds":3}}'
    )
    assert ONE.hash == "f1812a57f03ac6e29e2d"


@examples(max_examples=30)
@given(SETTINGS, st.integers())
def test_order_does_not_matter_and_the_canonical_form_says_all(
    settings: dict[str, object], seed: int
) -> None:
    spec = Spec("a.b:c", settings, seed)
    turned = Spec("a.b:c", dict(reversed(settings.items())), seed)
    assert (turned, turned.hash) == (spec, spec.hash)
    assert spec.settings == settings
    assert spec_of(spec.canonical()) == spec


def test_every_part_counts() -> None:
    settings = ONE.settings
    others = [
        Spec("engine_runs:sums", settings, 7),
        Spec(ONE.function, settings, 8),
        Spec(ONE.function, {**settings, "rate": 0.1000000001}, 7),
        Spec(ONE.function, {**settings, "rounds": 3.0}, 7),
        Spec(ONE.function, settings, 7, [ONE]),
        Spec(ONE.function, settings, 7, [ONE, ONE]),
    ]
    assert len({ONE.hash, *(own.hash for own in others)}) == 7
    assert spec_of(others[5].canonical()) == others[5]


def test_it_is_frozen_and_travels() -> None:
    ONE.settings["rounds"] = 99
    assert ONE.settings["rounds"] == 3
    assert pickle.loads(pickle.dumps(ONE)) == ONE
    assert {ONE: 1}[pickle.loads(pickle.dumps(ONE))] == 1
    assert ONE.label == "noisy seed 7"
    assert Spec("m:f", {"run": "A1"}, 3).label == "A1 seed 3"


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"a": {"b": [1.0, float("nan")]}}, r"nan cannot .*\[settings\.a\.b\[1\]\]"),
        ({"a": float("inf")}, "inf cannot"),
        ({"a": {1: 2}}, "the key 1 is no text"),
        ({"a": b"x"}, "cannot be part of"),
        ({"a": {2, 3}}, "cannot be part of"),
    ],
)
def test_settings_that_json_does_not_keep_are_refused(settings: dict[str, object], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        Spec("m:f", settings, 0)


def test_what_is_no_run_is_refused() -> None:
    with pytest.raises(UsageError, match="no module:attribute"):
        Spec("engine_runs.noisy", {}, 0)
    for text in ("", "[]", '{"function": "m:f"}', "7"):
        with pytest.raises(UsageError, match="describes no run"):
            spec_of(text)


def test_a_run_gets_what_it_needs_in_its_order() -> None:
    stages = [Spec("engine_runs:stage", {"marks": "/dev/null"}, seed) for seed in (1, 2)]
    tables = {own.hash: pl.DataFrame({"draw": [float(own.seed)]}) for own in stages}
    for order in (stages, stages[::-1]):
        found = run_one(Spec("engine_runs:sums", {}, 10, order), tables)
        assert found["value"].to_list() == [10 + own.seed for own in order]
    with pytest.raises(UsageError, match="needs the result of stage seed 2"):
        run_one(Spec("engine_runs:sums", {}, 0, stages), {stages[0].hash: pl.DataFrame()})


def test_a_function_that_is_not_there_is_refused() -> None:
    with pytest.raises(UsageError, match=r"nowhere.* cannot be loaded"):
        run_one(Spec("nowhere:f", {}, 0), {})


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (None, "nothing measured"),
        ([], "nothing measured"),
        ([1.0, 2.0], "1.0, which is no measurement"),
        ([Measured(0, "", "", "mean", "error", "much")], "'much'"),  # type: ignore[arg-type]
        ([Measured(0.5, "", "", "mean", "error", 1.0)], "0.5"),  # type: ignore[arg-type]
        ([(0, "", "", None, "error", 1.0)], "None"),
        ([(0, "", "error", 1.0)], "no measurement"),
        ([Measured(0, "", "", "mean", "error", v) for v in (1.0, 2.0)], r"'error'\) twice"),
    ],
)
def test_what_is_no_measurement_is_refused(found: object, said: str) -> None:
    with pytest.raises(DataError, match=said):
        measured_table(found, "engine_runs:noisy")
