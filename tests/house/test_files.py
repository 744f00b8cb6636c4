"""The house: a file is a topic, its name a term of the field, and a class name stands once in the core."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

from syntax_trees import statements, tree

SOURCE = Path(__file__).parents[2] / "src"
FRAGMENT = 60
"""Lines. A shorter module that one other imports lives with it, unless it is loaded by name or late."""
BANNED = """again along anew around aside beside between cause changed commanded common crowded drawn each
fading fewer foreign foretold found given grown held helpers held_out in_use judged kept ladder lean left_out
made manner measured mended misc more news of_file of_robot once others own passed planned played pull quickly
recipe recipes recorded remembered rest rung rungs seen several settled short shown single spare stance
stand_ins standing steps stored stuck things together told tools truth tuned unheld unseen use utilities utils
various way ways words"""
"""Participles, adverbs and vague words: nobody looks for a topic under them."""
CLAUSES = ["How", "Has", "Is", "Under", "What", "When", "Where", "Which", "Who", "Whose"]
"""Words that begin a question or a clause: a file's first line names its topic by a noun."""


@cache
def modules() -> dict[str, Path]:
    """All of `src`, without packages' own files and the programs that are copied to robots."""
    paths = (path for path in sorted(SOURCE.rglob("*.py")) if path.parent.name != "players")
    names = {".".join(path.relative_to(SOURCE).with_suffix("").parts): path for path in paths}
    return {name: path for name, path in names.items() if path.stem not in ("__init__", "__main__")}


def importers() -> dict[str, dict[str, bool]]:
    """Of each module who imports it, and whether at the top, when the importer is loaded."""
    found: dict[str, dict[str, bool]] = defaultdict(dict)
    known = set(modules())
    for name, path in modules().items():
        at_top = {id(node) for node in tree(path).body}
        for node in statements(tree(path)):
            if isinstance(node, ast.ImportFrom):
                targets = {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
            elif isinstance(node, ast.Import):
                targets = {alias.name for alias in node.names}
            else:
                continue
            for target in (targets & known) - {name}:
                found[target][name] = found[target].get(name, False) or id(node) in at_top
    return found


def test_a_fragment_lives_with_its_only_importer() -> None:
    found = []
    text = "".join(path.read_text(encoding="utf-8") for path in modules().values())
    for name, of in importers().items():
        (other, at_top), *more = of.items()
        lines = len(modules()[name].read_text(encoding="utf-8").splitlines())
        same = name.split(".")[0] == other.split(".")[0]
        if not more and at_top and same and lines < FRAGMENT and f'"{name}:' not in text:
            found.append(f"{name} ({lines} lines) is imported by {other} alone: fold it into that")
    assert found == []


def test_files_are_named_by_terms_of_the_field() -> None:
    found = [name for name, path in modules().items() if path.stem in BANNED.split()]
    assert found == []


def test_a_file_names_its_topic_in_its_first_line() -> None:
    studies = SOURCE.parent / "packages" / "etude-studies" / "src"
    paths = [path for base in (SOURCE, studies) for path in base.rglob("*.py")]
    first = {str(path.relative_to(SOURCE.parent)): ast.get_docstring(tree(path)) or "" for path in paths}
    assert len(first) > 600
    assert [name for name, line in sorted(first.items()) if line.partition(" ")[0] in CLAUSES] == []


def test_a_class_name_stands_once_in_the_core() -> None:
    places = defaultdict(list)
    for name, path in modules().items():
        if name.split(".")[0] == "etude":
            for node in tree(path).body:
                if isinstance(node, ast.ClassDef):
                    places[node.name].append(name)
    assert {name: of for name, of in places.items() if len(of) > 1} == {}


def numeric(value: ast.expr | None) -> bool:
    """Whether an expression is a number, or made of numbers alone."""
    match value:
        case ast.Constant(value=bool()):
            return False
        case ast.Constant(value=int() | float()):
            return True
        case ast.UnaryOp(operand=inner):
            return numeric(inner)
        case ast.BinOp(left=left, right=right):
            return numeric(left) and numeric(right)
        case ast.Tuple(elts=parts):
            return all(map(numeric, parts))
    return False


def test_a_constant_says_what_it_is_of_and_why() -> None:
    """A comment on its line or above, or a docstring below."""
    found = []
    for name, path in modules().items():
        lines, body = path.read_text(encoding="utf-8").splitlines(), tree(path).body
        for node, below in zip(body, [*body[1:], None], strict=True):
            if not isinstance(node, ast.Assign | ast.AnnAssign) or not numeric(node.value):
                continue
            text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
            above = lines[node.lineno - 2].startswith("#")
            if not (text or above or "#" in lines[(node.end_lineno or node.lineno) - 1]):
                found.append(f"{name}:{node.lineno}: {lines[node.lineno - 1]}")
    assert found == []


COMPILED = {"compiled", "_compile"}
PARTS = {"compiled_part", "_inline"}
"""Decorators of functions that compiled functions of their file alone call: Python would crash in them."""


def test_parts_of_compiled_functions_are_called_by_these_alone() -> None:
    found = []
    for name, path in modules().items():
        text = path.read_text(encoding="utf-8")
        if not any(f"@{word}\n" in text for word in PARTS):
            continue
        functions = [own for own in tree(path).body if isinstance(own, ast.FunctionDef)]
        marks = {own.name: {ast.unparse(one) for one in own.decorator_list} for own in functions}
        parts = {own for own, words in marks.items() if words & PARTS}
        for own in tree(path).body:
            inside = isinstance(own, ast.FunctionDef) and marks[own.name] & (COMPILED | PARTS)
            used = {node.id for node in ast.walk(own) if isinstance(node, ast.Name)} & parts
            found += [f"{name}:{own.lineno}: {used}"] if used and not inside else []
        dotted = re.compile(rf"\b{path.stem}(\.| import .*\b)({'|'.join(parts)})\b(?!\.py_func)")
        for other in modules().values():
            found += [f"{other}: {one[0]}" for one in dotted.finditer(other.read_text(encoding="utf-8"))]
    assert found == []
