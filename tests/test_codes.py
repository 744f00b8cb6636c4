"""Notices: every code has a sentence that its fields fill, and JSON carries all of it."""

from __future__ import annotations

import json
from string import Formatter

import pytest

from etude.codes import SENTENCES, Alert, NextStep, Notice, OfFile, Phrase, Refusal, Stop, Warn

KINDS = (Alert, Warn, OfFile, Refusal, Stop, Phrase, NextStep)
WHERE = Notice(Phrase.LEFT_OUT, {"logs": 3})
OTHERS = "on 3 motions, each predicted from the others"
NOTICE = Notice(
    Alert.CONSTANT_AS_GOOD, {"outputs": ("hip", "knee"), "where": WHERE}, NextStep.MOVE_JOINTS, "red"
)


def test_each_code_is_one_word_with_one_sentence() -> None:
    codes = [code for kind in KINDS for code in kind]
    assert len(SENTENCES) == len(set(map(str, codes))) == len(codes)
    assert set(SENTENCES) == set(codes)


def test_a_field_that_is_missing_is_no_empty_place() -> None:
    for code, sentence in SENTENCES.items():
        if any(name for _, name, _, _ in Formatter().parse(sentence)) and not isinstance(code, NextStep):
            with pytest.raises(KeyError):
                Notice(code).sentence  # noqa: B018


def test_json_carries_code_fields_step_and_light() -> None:
    told = json.loads(json.dumps(NOTICE.facts()))
    assert told["code"] == "constant_as_good"
    assert told["fields"]["where"] == {"code": "left_out", "fields": {"logs": 3}}
    assert (told["next_step"], told["light"]) == ("move_joints", "red")
    assert told["sentence"] == NOTICE.sentence
    assert Notice.from_json(told) == NOTICE


@pytest.mark.parametrize(
    ("notice", "sentence"),
    [
        (
            NOTICE,
            f"hip, knee: {OTHERS}, a constant would have predicted as well",
        ),
        (Notice(Stop.LOGS_MISSING, {"logs": 1}), "1 more log before a stop rule applies"),
        (Notice(Stop.LOGS_MISSING, {"logs": 2}), "2 more logs before a stop rule applies"),
        (
            Notice(Stop.TOLERANCE, {"forecast": 0.0123, "goal": 0.02}),
            "The expected command error is 1.2 % of the command limit, within 2 %",
        ),
        (
            Notice(Stop.OPEN, {"open": (WHERE, WHERE)}),
            f"No stop rule applies yet: {OTHERS}; {OTHERS}",
        ),
        (
            Notice(Warn.INPUTS_MISSING, {"inputs": ("a", "b")}),
            "Inputs excluded from the model, because some logs lack them: a and b",
        ),
    ],
)
def test_sentences(notice: Notice, sentence: str) -> None:
    assert notice.sentence == sentence


def test_a_bare_text_is_a_sentence_that_something_stated() -> None:
    said = Notice.from_json("No battery was logged.")
    assert (said.code, str(said), said.step) == (Warn.STATED, "No battery was logged.", "")


@pytest.mark.parametrize(
    "value", [3, None, {}, {"code": "nothing"}, {"code": "open", "fields": {"open": {}}}]
)
def test_what_is_no_notice_is_refused(value: object) -> None:
    with pytest.raises(ValueError, match="no notice"):
        Notice.from_json(value)
