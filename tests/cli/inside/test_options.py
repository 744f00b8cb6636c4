"""Options of export targets: an unknown one is answered with those that a user may type, as typed."""

from __future__ import annotations

from dataclasses import dataclass, fields

import pytest

from etude._runtime.options import FLAGS, taken
from etude.cli.export import Export
from etude.errors import UsageError


@dataclass(frozen=True)
class Options:
    samples: object = None
    fade: bool = True
    interface: str = ""
    model_hash: str = ""


def test_an_unknown_option_is_answered_with_those_of_users_as_they_are_typed() -> None:
    with pytest.raises(UsageError, match="--to t has no option --set interfase=VALUE") as problem:
        taken({"interfase": "x"}, Options, "t")
    step = problem.value.next_step
    assert step == "Did you mean interface? It has --no-fade, --set interface=VALUE."
    with pytest.raises(UsageError, match=r"Write --set fade=yes or --set fade=no\."):
        taken({"fade": "perhaps"}, Options, "t")


def test_the_flags_are_those_of_the_command() -> None:
    own = {field.name: field.default for field in fields(Export)}
    typed = {name: f"--{'no-' if own[name] is True else ''}{name}" for name in FLAGS}
    assert typed == FLAGS
