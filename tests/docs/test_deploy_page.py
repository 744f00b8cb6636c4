"""The page on C, followed as a new user would: exported, compiled, run."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from test_docs import ROOT, blocks

from compilers import STRICT, run, tool

PAGE = ROOT / "docs" / "deploy_c.md"


@pytest.mark.slow
def test_the_page_ends_in_a_command(tmp_path: Path) -> None:
    first, building = blocks(PAGE, "sh")
    for line in first.splitlines():
        words = shlex.split(line)
        assert words[0] == "etude"
        run([sys.executable, "-m", "etude", *words[1:]], tmp_path)
    folder = tmp_path / "lab" / "exports" / "c"
    (program,) = blocks(PAGE, "c")
    (folder / "main.c").write_text(program, encoding="utf-8")
    run([tool("gcc"), *STRICT, "main.c", "arm.c", "-lm", "-o", "strict"], folder)
    tool("cmake")
    for line in building.splitlines():
        done = subprocess.run(
            ["sh", "-c", line.split("#")[0]], cwd=folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
    assert "100% tests passed" in done.stdout
