"""The name on the package index is not ours: no sentence sends anybody there; who shares it is named."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import etude
from etude import cli
from etude.logs import needed

ROOT = Path(__file__).parents[1]
FROM_THE_INDEX = re.compile(
    r"""(?:pipx?|uv|uvx)\s+(?:pip\s+|tool\s+)?(?:install|add|run|inject)\s+(?:-\S+\s+)*['"]?etude(?![\w/.])"""
    r"""|['"`]etude(?:-studies|-sdk)?\[""",
    re.IGNORECASE,
)
"""`pip install etude`, `pipx install etude[ros]`, `uv tool install etude`, or an extra by the name alone."""


@pytest.mark.parametrize(
    "sentence",
    [
        "pip install etude",
        "pip install -U 'etude[ros]'",
        "pipx install etude",
        "uv tool install etude",
        "'etude[px4]'",
    ],
)
def test_the_search_finds_such_sentences(sentence: str) -> None:
    assert FROM_THE_INDEX.search(sentence)


@pytest.mark.parametrize(
    "sentence",
    [
        "pip install .",
        "pip install '.[ros]'",
        "uvx --from dist/*.whl etude demo",
        "pipx install dist/etude-0.2.0.whl",
    ],
)
def test_the_search_lets_the_others_be(sentence: str) -> None:
    assert not FROM_THE_INDEX.search(sentence)


def pages() -> list[Path]:
    """What users read: messages in the code, docs, README, notebooks, settings. One record
    tells of the clash.
    """
    folders = ("src", "docs", "examples", "packages", "packaging", ".github", ".ci")
    found = [*ROOT.glob("*.md"), *ROOT.glob("*.toml"), ROOT / "Dockerfile"]
    for folder in folders:
        found += [
            path
            for path in (ROOT / folder).rglob("*")
            if path.suffix in (".py", ".md", ".toml", ".ipynb", ".yml", ".yaml")
        ]
    record = ROOT / "docs" / "decisions" / "0048-name-on-the-index.md"
    return [path for path in found if path.is_file() and path != record]


def test_no_sentence_installs_a_strangers_package() -> None:
    found = pages()
    assert len(found) > 300
    bad = []
    for path in found:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if FROM_THE_INDEX.search(line):
                bad.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:120]}")
    assert bad == []


def test_a_missing_library_is_named_with_what_needs_it() -> None:
    with pytest.raises(etude.errors.UsageError, match="writing a table needs no_such_library") as problem:
        needed("no_such_library.part", "writing a table")
    assert problem.value.next_step == "Install it: pip install 'no_such_library'"


def test_the_version_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    studies = tomllib.loads((ROOT / "packages/etude-studies/pyproject.toml").read_text(encoding="utf-8"))[
        "project"
    ]
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.split()[1] == project["version"] == studies["version"] == etude.__version__
    assert f"## [{project['version']}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"version: {project['version']}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'"{project["version"]}"' in (ROOT / "packaging/conda/meta.yaml").read_text(encoding="utf-8")
