"""Files for people who join: recipes ask for what the package asks for, CI runs the script of everybody."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CONDA_NAMES = {"mujoco": "mujoco-python"}
"""Where conda-forge calls the Python package otherwise."""


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_conda_recipe_asks_for_what_pip_asks_for() -> None:
    recipe = text("packaging/conda/meta.yaml")
    run = recipe.partition("  run:\n")[2].partition("\ntest:")[0]
    asked = {line.strip("- ").replace(" ", "") for line in run.splitlines() if line.strip()}
    wanted = {f"python{PROJECT['requires-python']}"}
    for line in PROJECT["dependencies"]:
        name, bounds = re.fullmatch(r"([\w-]+)(.*)", line).groups()  # type: ignore[union-attr]
        wanted.add(f"{CONDA_NAMES.get(name, name)}{bounds}")
    assert asked == wanted


@pytest.mark.parametrize(("workflow", "script"), [("ci.yml", ".ci/run"), ("nightly.yml", ".ci/nightly")])
def test_a_public_forge_runs_the_script(workflow: str, script: str) -> None:
    assert f"- run: bash {script}\n" in text(f".github/workflows/{workflow}")
    assert (ROOT / script).exists()


def test_the_image_copies_what_the_wheel_is_made_of() -> None:
    copied = re.findall(r"^COPY (.+) \S+$", text("Dockerfile"), re.MULTILINE)
    names = {name for line in copied for name in line.split()}
    assert {"pyproject.toml", PROJECT["readme"], *PROJECT["license-files"], "src", "examples"} <= names
    assert not names & set(text(".dockerignore").split())


def test_links_of_project_pages_lead_somewhere() -> None:
    for name in ("CHANGELOG.md", "SECURITY.md", "ROADMAP.md", "CODE_OF_CONDUCT.md"):
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text(name)):
            assert "://" in target or (ROOT / target).exists(), f"{name} links to {target}"


def test_a_security_report_has_an_address_that_the_page_names() -> None:
    page = text("SECURITY.md")
    assert "## How to report" in page
    assert "## What is promised" in page
    assert "## What is not promised" in page
    assert "docs/known_faults.md" in page
