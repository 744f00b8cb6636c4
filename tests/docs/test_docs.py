"""The code in README and docs is code that runs; the commands they show exist."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from etude import cli

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def blocks(page: Path, language: str) -> list[str]:
    return [code for name, code in FENCE.findall(page.read_text(encoding="utf-8")) if name == language]


BRIEFLY = """
from dataclasses import replace
from etude.campaign import create
from etude_arm import motions
whole = create.preset_config
def brief(kind, name):
    own = whole(kind, name)
    model = replace(own.model, points=100, fit_points=60, steps=3, candidates=("default",))
    return replace(own, model=model, design=replace(own.design, candidates=4, refine=1, steps=2))
create.preset_config, motions.MOVES, motions.TEST_DURATION = brief, 2, 10.0
"""
"""Run before a page that simulates: how well its campaign learns is not what it shows."""


@pytest.mark.slow  # in .ci/run, with the rest of the documentation
@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: p.name)
def test_python_blocks_run(page: Path, tmp_path: Path) -> None:
    """All Python blocks of a page run as one program, beside the examples alone, without a warning."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    code = "\n".join(blocks(page, "python"))
    if "simulate(" in code:
        code = f"exec({BRIEFLY!r}, {{}})\n{code}"
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def shell_commands() -> list[tuple[str, str]]:
    """Every `etude ...` line in a shell block, with its page."""
    found = []
    for page in PAGES:
        for block in blocks(page, "sh") + blocks(page, "bash"):
            for line in block.replace("\\\n", " ").splitlines():
                for part in line.split("&&"):
                    words = part.split("#")[0].strip()
                    if words.startswith("etude ") and not words.startswith("etude --"):
                        found.append((page.name, words))
    return found


COMMANDS = {" ".join(line.split()[:2]): page for page, line in reversed(shell_commands())}
"""Each once, with the first page that names it."""


@pytest.mark.parametrize("line", sorted(COMMANDS))
def test_commands_named_in_the_docs_exist(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    cli.main([*shlex.split(line)[1:], "--help"])
    said = capsys.readouterr().out
    assert said.startswith(f"usage: {line} "), f"{COMMANDS[line]}: {line}: {said[:80]}"


def test_the_first_screen_holds_the_two_commands() -> None:
    first_screen = "\n".join((ROOT / "README.md").read_text(encoding="utf-8").splitlines()[:40])
    assert "pip install . && etude demo" in first_screen
    assert "pip install '.[test]' && pytest" in first_screen


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name} links to {target}"
