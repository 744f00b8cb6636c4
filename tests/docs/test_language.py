"""The pages read as a manual does: short sentences, standard terms, bounded length, links to headings."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

import pytest
from test_docs import ROOT

DOCS = ROOT / "docs"
GENERATED = (DOCS / "thesis.md", DOCS / "reference" / "codes.md")
PAGES = [
    ROOT / "README.md",
    *(p for p in sorted(DOCS.rglob("*.md")) if p not in GENERATED and p.parent.name != "decisions"),
]
LONGEST_SENTENCE = 30
MOST_WORDS = 35_000

DIALECT = re.compile(
    r"\b(foretold|rungs?|told|tells?|nobody|unheld|stand-ins?|said so|says so beside|what is left of)\b",
    re.IGNORECASE,
)
"""Words of no textbook, or personifications; commands in code spans keep their names."""


def prose(text: str) -> list[str]:
    """Paragraphs, list items and headings without code, tables, pictures and link targets."""
    text = re.sub(r"^(?:> )?```.*?^(?:> )?```$", "\n", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^(\||:::|    |<a ).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"`[^`]+`", "code", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"^(#+ .*)$", r"\n\1\n", text, flags=re.MULTILINE)
    text = re.sub(r"^\s*(?:[-*] |\d+\. |> )", "\n", text, flags=re.MULTILINE)
    return [" ".join(part.split()) for part in re.split(r"\n\s*\n", text) if part.strip()]


def sentences(text: str) -> list[str]:
    return [
        one
        for part in prose(text)
        for one in re.split(r"(?<!et al\.)(?<=[.?!])[)*_\"]*\s+(?=\S)", part)
        if one
    ]


def words(text: str) -> list[str]:
    return [word for word in text.split() if re.search(r"\w", word)]


def test_sentences_are_counted_as_a_reader_does() -> None:
    text = "# Head\nOne `a b c` two. Three [four five](x.md#y) six?\n\n| a | b |\n\n* seven\n* eight nine.\n"
    assert [len(words(one)) for one in sentences(text)] == [1, 3, 4, 1, 2]
    assert sentences("```sh\netude ask\n```\n") == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_no_sentence_is_long(page: Path) -> None:
    found = sentences(page.read_text(encoding="utf-8"))
    assert [one for one in found if len(words(one)) > LONGEST_SENTENCE] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_words_are_those_of_the_field(page: Path) -> None:
    parts = prose(page.read_text(encoding="utf-8"))
    assert [f"{found[0]}: {part}" for part in parts for found in DIALECT.finditer(part)] == []


def read(page: Path) -> list[str]:
    """Words of a page, its tables too; numbers and blocks of code are none."""
    text = re.sub(
        r"^(?:> )?```.*?^(?:> )?```$", "\n", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    return [word for word in text.split() if re.search(r"[^\W\d_]", word)]


def test_the_pages_stay_short() -> None:
    counted = {str(page.relative_to(ROOT)): len(read(page)) for page in PAGES if page.parent != ROOT}
    assert sum(counted.values()) <= MOST_WORDS, counted
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 90


def anchors(page: Path) -> set[str]:
    """Headings as Python-Markdown and GitHub make anchors of them, and anchors written by hand."""
    text = page.read_text(encoding="utf-8")
    body = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    found = set(re.findall(r"<a id=\"([^\"]+)\"", body))
    for heading in re.findall(r"^#+ (.+)$", body, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "")
        plain = unicodedata.normalize("NFKD", plain).encode("ascii", "ignore").decode()
        slug = re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())
        found.add(slug)
    return found


LINKING = sorted({*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / "examples").rglob("README.md")})


@pytest.mark.parametrize("page", LINKING, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_to_a_page_and_a_heading(page: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    broken = []
    for name, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)", text):
        if "://" in name or name.startswith("mailto:"):
            continue
        target = page.parent / name if name else page
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            broken.append(f"{name}#{anchor}")
    assert broken == []


SOURCES = (ROOT, ROOT / "src", *(p for p in (ROOT / "src").iterdir() if p.is_dir()))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_modules_that_are_named_exist(page: Path) -> None:
    """`design/solve.py`, from the root, `src` or a package; a name alone may stand anywhere below them."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    named = set(re.findall(r"`([\w/.-]+\.py)`", text))
    exported = {
        "play.py",
        "my_kernel.py",
        "make_ulg.py",
        "catalogue.py",
        "collected.py",
        "run_file.py",
        "spec.py",
    }
    missing = [
        name
        for name in sorted(named - exported)
        if not any((root / name).exists() for root in SOURCES)
        and ("/" in name or not any((ROOT / "src").rglob(name)))
    ]
    assert missing == []


OTHERS = {"ControlAllocator", "MulticopterPositionControl", "WorkQueueManager", "FrankaRobotState"}
"""Names of PX4 and ROS."""


def test_classes_that_are_named_exist() -> None:
    """`Kind`, `Inputs.plan`, `etude.testing.LimitSuite`: the class is defined in this repository."""
    files = [path for folder in ("src", "packages", "examples") for path in (ROOT / folder).rglob("*.py")]
    code = "\n".join(path.read_text(encoding="utf-8") for path in files)
    known = {
        *re.findall(r"^class (\w+)", code, re.MULTILINE),
        *re.findall(r"^(\w+) = ", code, re.MULTILINE),
        *OTHERS,
    }
    missing = []
    for page in PAGES:
        text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        named = re.findall(r"`(?:\w+\.)*([A-Z][a-z]+[A-Za-z]*)(?:\.\w+)?(?:\([^`]*\))?`", text)
        missing += [f"{page.name}: {name}" for name in named if name not in known]
    assert missing == []
