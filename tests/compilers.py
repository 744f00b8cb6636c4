"""C compilers for tests of generated code; a test is skipped where one is missing."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

REQUIRED = "ETUDE_COMPILERS_REQUIRED"
"""Of the environment: set by CI, where a skipped test of generated code would be a gap."""
INSTALL = "apt-get install -y gcc clang cmake"
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
SANITIZED = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
FAST = ("-O3", "-ffast-math", "-march=native")


def tool(name: str) -> str:
    """The program of that name. Skips where there is none, unless required."""
    found = shutil.which(name)
    if found is None:
        if os.environ.get(REQUIRED):
            pytest.fail(f"there is no {name}, and {REQUIRED} says there must be one: {INSTALL}")
        pytest.skip(f"there is no {name}: {INSTALL}")
    return found


def run(command: list[str], folder: Path) -> str:
    """What a program says; the test fails with its words unless it ends with 0."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}\n{done.stderr[-4000:]}"
    return done.stdout
