"""The pages on logs, followed as a new user would: every log that they name is read, and if slow, told."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from test_docs import ROOT, blocks

import etude
from etude.campaign import CONFIG


def lines(page: Path) -> list[list[str]]:
    """Words of each etude command of a page."""
    found = [line for block in blocks(page, "sh") for line in block.splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in found if line.startswith("etude ")]


PAGES = [
    page
    for page in sorted((ROOT / "docs").glob("logs_*.md"))
    if any(words[0] != "bench" for words in lines(page))
]
"""Pages of a format of logs; one whose commands are all benches is a page of figures."""


INSTALL = re.compile(r"pip install '\.\[(\w+)\]'")
ANY_FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_no_block_is_passed_over(page: Path) -> None:
    """Shell lines install an extra that there is, or are run below; TOML and text are used below."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for language, block in ANY_FENCE.findall(page.read_text(encoding="utf-8")):
        assert language in ("sh", "toml", "text"), language
        for line in block.splitlines() if language == "sh" else ():
            found = INSTALL.fullmatch(line)
            assert line.startswith("etude ") or (found and found[1] in extras["optional-dependencies"]), line


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    """A folder with the examples in it, where the page's extra is installed."""
    for extra, library in (("ros", "rosbags"), ("px4", "pyulog")):
        if f"pip install '.[{extra}]'" in request.getfixturevalue("page").read_text(encoding="utf-8"):
            pytest.importorskip(library, reason=f"the page needs the extra '{extra}'")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def configured(page: Path, folder: str) -> None:
    """Puts the page's TOML in place of the table [log], as it says."""
    for block in blocks(page, "toml"):
        path = Path(folder) / CONFIG
        head, table, _ = path.read_text(encoding="utf-8").partition("[log]")
        assert table
        path.write_text(head + block, encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_every_log_on_the_page_is_read(page: Path, place: Path) -> None:
    robot, read = None, 0
    for words in lines(page):
        if words[0] == "init":
            robot, _ = etude.create_campaign(words[1], words[words.index("--robot") + 1])
        elif words[0] == "tell":
            if read:
                configured(page, words[1])
                robot = etude.open_campaign(words[1])
            topics = words[words.index("--topic") + 1 :][:1] if "--topic" in words else []
            log = etude.read_log(words[2], robot, topics=topics)
            assert len(log) > 400
            read += 1
    assert read


@pytest.mark.slow
@pytest.mark.parametrize("page", [*PAGES, ROOT / "docs" / "inspect.md"], ids=lambda p: p.stem)
def test_every_command_of_the_page_runs(page: Path, place: Path) -> None:
    told = 0
    for words in lines(page):
        if words[0] == "tell" and told:
            configured(page, words[1])
        told += words[0] == "tell"
        words = [word.replace("LOG", "examples/ur10/ur10_exciting.csv") for word in words]
        command = [sys.executable, "-m", "etude", *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{words}: {done.stderr}"
