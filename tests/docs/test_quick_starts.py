"""Each quick start, followed as a new user would: every command in turn, and what the page promises is said.

Figures are not compared: another processor rounds otherwise. Words, files and their order are.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_docs import ROOT

PAGES = sorted((ROOT / "docs" / "start").glob("*.md"))
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
INSTALL = re.compile(r"pip install '\.\[(\w+)\]'")
LIBRARIES = {"ros": "rosbags", "px4": "pyulog"}


def steps(page: Path) -> Iterator[tuple[str, str]]:
    """("sh", a command), ("text", a line that must be said by then) and ("python", a block), in turn."""
    for language, block in FENCE.findall(page.read_text(encoding="utf-8")):
        if language == "python":
            yield language, block
        else:
            yield from ((language, line) for line in block.splitlines() if line.strip())


def without_figures(text: str) -> str:
    return re.sub(r"[\d.]+", "#", " ".join(text.split()))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_a_page_is_nothing_but_what_is_tried(page: Path) -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = list(steps(page))
    assert {language for language, _ in found} <= {"sh", "text", "python"}
    for language, line in found:
        install = INSTALL.fullmatch(line)
        if language == "sh" and not line.startswith("etude "):
            assert install, line
            assert install[1] in extras["optional-dependencies"], line
    assert "text" in dict(found)
    assert "**The result**" in page.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_it_ends_in_its_result(page: Path, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    said = ""
    for language, step in steps(page):
        if language == "text":
            assert without_figures(step) in said, f"{step!r} is not said:\n{said}"
            said = said.partition(without_figures(step))[2]
            continue
        install = INSTALL.fullmatch(step)
        if install:
            pytest.importorskip(LIBRARIES[install[1]], reason=f"the page needs the extra '{install[1]}'")
            continue
        words = ["-c", step] if language == "python" else ["-m", *shlex.split(step)]
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{step}: {done.stderr}"
        said = without_figures(done.stdout)
    assert len(PAGES) == 5
