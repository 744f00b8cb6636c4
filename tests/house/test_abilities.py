"""The house: what the pipeline asks of a part is declared, and the first file stays short."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from syntax_trees import imports_and_calls

from etude import abilities, protocols
from etude.abilities import ABILITIES
from etude.errors import UsageError
from etude.plugins import require_whole
from etude.protocols import members

SOURCE = Path(__file__).parents[2] / "src"
FIRST_FILE = 400
"""Lines of `protocols`: read in ten minutes."""
FOREIGN = {
    "etude/plugins.py": "typing's mark of a protocol",
    "etude/plugin_values.py": "typing's mark of a protocol",
    "etude/protocols.py": "typing's mark of a protocol",
    "etude/design/criteria.py": "name and module of a criterion, which may be any callable",
    "etude/logs/readers/ros_messages.py": "messages of ROS, made from their definitions",
    "etude/logs/readers/log_file.py": "the operating system's word on an error",
    "etude/cli/parse.py": "typing's and tyro's marks of an argument",
    "etude/cli/doctor.py": "functions that some operating systems lack",
    "etude/cli/outcome.py": "arrays and numbers of NumPy and polars",
    "etude_online/learner_state.py": "named tuples",
    "etude_drivers/lerobot.py": "robots of LeRobot, of many kinds",
}
"""Files that ask objects of other libraries for an attribute by name, and which objects these are."""


@cache
def all_calls() -> dict[str, tuple[tuple[str, ast.Call], ...]]:
    """Calls by the function's name, by path under src, without the programs that are copied to robots."""
    paths = [path for path in sorted(SOURCE.rglob("*.py")) if path.parent.name != "players"]
    return {
        str(path.relative_to(SOURCE)): tuple(
            (node.func.id, node)
            for node in imports_and_calls(path)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        )
        for path in paths
    }


def calls(*names: str) -> Iterator[tuple[str, ast.Call]]:
    """(path, call) of functions of these names."""
    return ((path, call) for path, own in all_calls().items() for name, call in own if name in names)


def test_no_part_is_asked_for_an_attribute_that_no_protocol_declares() -> None:
    found = {
        f"{path}:{call.lineno} asks for {call.args[1].value!r}"
        for path, call in calls("getattr", "hasattr")
        if isinstance(call.args[1], ast.Constant) and path not in FOREIGN
    }
    assert found == set(), "declare it in etude.abilities, and ask by isinstance"


def test_what_is_foreign_is_still_asked_for() -> None:
    assert set(FOREIGN) <= {path for path, _ in calls("getattr", "hasattr")}


def test_the_first_file_stays_short() -> None:
    lines = Path(protocols.__file__).read_text(encoding="utf-8").splitlines()
    assert len(lines) <= FIRST_FILE


def test_every_ability_is_listed_and_asked_for() -> None:
    declared = {name for name in vars(abilities) if name.startswith("Supports")}
    listed = {ability.__name__ for own in ABILITIES.values() for ability in own}
    asked = {
        name.id
        for _, call in calls("isinstance")
        for name in ast.walk(call.args[1])
        if isinstance(name, ast.Name)
    }
    assert declared == listed
    assert declared - asked == set(), "nothing asks for these"


@pytest.mark.parametrize("part", ABILITIES)
def test_the_first_word_of_an_ability_names_its_part(part: str) -> None:
    for ability in ABILITIES[part]:
        assert part in (ability.__doc__ or "").partition(": ")[0], ability.__name__


def test_half_an_ability_is_refused_with_its_protocol() -> None:
    class Old:
        looks_at = ("Collisions",)

    with pytest.raises(UsageError, match="has looks_at and lacks not_verified") as refused:
        require_whole(Old(), "Limit", "[[limit]] my_limits:old")
    assert "etude.abilities.SupportsCoverage" in refused.value.next_step
    require_whole(object(), "Limit", "nothing of any ability")
    assert members(abilities.SupportsCoverage) == ("looks_at", "not_verified")
