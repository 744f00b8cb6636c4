"""What users import has types: mypy reads the code of the docs, and every public name, as from outside."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest
from test_docs import PAGES, blocks

FACES = (
    "etude",
    "etude.campaign",
    "etude.deploy",
    "etude.design",
    "etude.limits",
    "etude.logs",
    "etude.models",
    "etude.report",
    "etude.testing",
    "etude.trajectories",
    "etude_arm",
    "etude_lagrangian",
    "etude_online",
    "etude_quadrotor",
    "etude_sparse",
)
STRICT = (
    "--no-implicit-reexport",
    "--check-untyped-defs",
    "--strict-equality",
    "--extra-checks",
    "--disallow-any-unimported",
    "--warn-redundant-casts",
    "--no-incremental",
    "--config-file=",
)
"""What a project that uses Étude would turn on; functions of examples may lack annotations."""


def checked(folder: Path) -> list[str]:
    """What mypy says of the files of a folder, line by line."""
    command = [sys.executable, "-m", "mypy", *STRICT, "."]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    return done.stdout.splitlines()


@pytest.mark.slow  # in .ci/run, with the rest of the documentation
def test_public_names_and_the_code_of_the_docs_have_types(tmp_path: Path) -> None:
    for page in PAGES:
        code = "\n".join(blocks(page, "python"))
        if code:
            name = "_".join(page.with_suffix("").parts[-2:]).replace("-", "_")
            (tmp_path / f"{name}.py").write_text(code, encoding="utf-8")
    lines = ["from typing import reveal_type"]
    for face in FACES:
        lines += [f"import {face}"]
        lines += [f"reveal_type({face}.{name})" for name in importlib.import_module(face).__all__]
    (tmp_path / "public_names.py").write_text("\n".join(lines), encoding="utf-8")
    said = checked(tmp_path)
    assert [line for line in said if ": error:" in line] == []
    revealed = [line for line in said if "Revealed type" in line]
    assert len(revealed) > 200
    assert [line for line in revealed if line.endswith('"Any"')] == []
