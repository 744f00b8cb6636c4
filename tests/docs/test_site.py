"""The site: built from every page, without a link that leads nowhere, asking nobody for anything."""

from __future__ import annotations

import base64
import importlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import unquote

import pytest
from test_docs import ROOT

import etude
from chromium import chromium, complaints, open_page, overhang
from etude.protocols import members

DOCS = ROOT / "docs"
MODULES = ("abilities", "errors", "protocols", "testing", "types")
"""Public modules."""
LOOKED_AT = (
    "index.html",
    "start/arm_ros2.html",
    "cheat_sheet.html",
    "reference/protocols.html",
    "models.html",
)


def navigation() -> list[str]:
    """Every page that the configuration names."""
    found: list[str] = []

    def walk(entries: list[dict[str, Any]]) -> None:
        for entry in entries:
            for value in entry.values():
                found.append(value) if isinstance(value, str) else walk(value)

    walk(tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))["project"]["nav"])
    return found


def test_every_page_is_in_the_navigation_once() -> None:
    listed = navigation()
    assert len(set(listed)) == len(listed)
    own = [path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")]
    pages = [name for name in own if not re.fullmatch(r"decisions/\d{4}-.*", name)]
    assert sorted(set(pages) - set(listed)) == [], "give them a place in zensical.toml"
    assert sorted(set(listed) - set(pages)) == []


def test_no_page_links_out_of_the_folder_that_is_built() -> None:
    """Such a link works in the repository and breaks the site: name the file instead."""
    leaving = [
        f"{page.relative_to(DOCS)}: {target}"
        for page in DOCS.rglob("*.md")
        for target in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", page.read_text(encoding="utf-8"))
        if not (page.parent / target).resolve().is_relative_to(DOCS.resolve())
    ]
    assert leaving == []


def test_every_decision_is_in_their_list() -> None:
    text = (DOCS / "decisions" / "README.md").read_text(encoding="utf-8")
    assert [p.name for p in (DOCS / "decisions").glob("0*.md") if f"({p.name})" not in text] == []


def test_the_reference_has_every_public_name() -> None:
    pages = {page.stem: page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.md")}
    for module, names in (("etude", etude.__all__), ("testing", etude.testing.__all__)):
        told = re.findall(r"^::: (\S+)\.(\w+)$", pages[module], re.MULTILINE)
        for place, name in told:
            assert getattr(importlib.import_module(place), name)
        assert {name for _, name in told} == {n for n in names if n not in MODULES}
    for name in MODULES:
        assert any(f"::: etude.{name}\n" in text or name == page for page, text in pages.items()), name


def test_pictures_of_the_gallery_are_those_that_its_command_makes() -> None:
    shown = set(re.findall(r"images/gallery/([\w.]+)", (DOCS / "gallery.md").read_text(encoding="utf-8")))
    made = set(re.findall(r'"(\w+\.(?:svg|png))"', (DOCS / "gallery.py").read_text(encoding="utf-8")))
    assert shown == {path.name for path in (DOCS / "images" / "gallery").iterdir()} == made


class Links(HTMLParser):
    """Targets, anchors and loaded things of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        own = {name: value or "" for name, value in attrs}
        self.anchors |= {own[name] for name in ("id", "name") if name in own}
        if tag == "a" and "href" in own:
            self.links.append(own["href"])
        elif tag in ("script", "img", "iframe") and "src" in own:
            self.loaded.append(own["src"])
        elif tag == "link" and own.get("rel") in ("stylesheet", "icon", "preconnect", "preload"):
            self.loaded.append(own["href"])


# what follows builds the site, and is run by .ci/run


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, as the page says."""
    pytest.importorskip("zensical", reason="pip install '.[docs]'")
    pytest.importorskip("mkdocstrings", reason="pip install '.[docs]'")
    place = tmp_path_factory.mktemp("built")
    shutil.copy(ROOT / "zensical.toml", place)
    shutil.copytree(DOCS, place / "docs")
    shutil.copytree(ROOT / "src", place / "src", ignore=shutil.ignore_patterns("__pycache__", "results"))
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean"]
    environment = {**os.environ, "NO_COLOR": "1"}
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return place / "site"


@pytest.mark.slow
def test_no_link_leads_nowhere(site: Path) -> None:
    pages = {path: Links(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    assert len(pages) > 70
    broken = []
    for page, found in pages.items():
        if page.name == "404.html":  # shown in the place of any other
            continue
        for link in found.links:
            if "://" in link or link.startswith(("mailto:", "javascript:")):
                continue
            name, _, anchor = unquote(link).partition("#")
            target = (page.parent / name).resolve() if name else page
            target = target / "index.html" if target.is_dir() else target
            if not target.exists() or (anchor and target in pages and anchor not in pages[target].anchors):
                broken.append(f"{page.relative_to(site)}: {link}")
    assert broken == []


@pytest.mark.slow
def test_the_page_of_protocols_lists_every_method(site: Path) -> None:
    """`back` of an exporter is no method of a protocol, and stands in the table above them."""
    text = (site / "reference" / "protocols.html").read_text(encoding="utf-8")
    found = Links(text).anchors
    both = [*vars(etude.protocols).values(), *vars(etude.abilities).values()]
    own = {value for value in both if getattr(value, "_is_protocol", False) and value is not Protocol}
    assert len(own) > 55
    wanted = {f"{one.__module__}.{one.__name__}.{name}" for one in own for name in members(one)}
    assert wanted - found == set()
    assert "<code>back(files)</code> returns" in text


@pytest.mark.slow
def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    for path in site.rglob("*.html"):
        loaded = Links(path.read_text(encoding="utf-8")).loaded
        assert [own for own in loaded if "//" in own] == [], path.name


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.parametrize("name", LOOKED_AT)
def test_pages_are_silent_and_no_wider_than_the_window(browser: Any, site: Path, name: str) -> None:
    for width in (400, 1280):
        open_page(browser, site / name, width)
        assert overhang(browser) == 0
        assert complaints(browser) == []
        loaded = browser.execute_script("return performance.getEntriesByType('resource').map((e) => e.name)")
        assert [own for own in loaded if own.startswith(("http:", "https:"))] == []


@pytest.mark.slow
@pytest.mark.browser
def test_search_works_from_the_file_system(browser: Any, site: Path) -> None:
    from selenium.webdriver.support.ui import WebDriverWait

    open_page(browser, site / "start" / "px4.html")
    wait = WebDriverWait(browser, 60)
    wait.until(lambda b: b.execute_script("return document.querySelector('.md-search__button') !== null"))
    browser.execute_script("document.querySelector('.md-search__button').click()")
    field = wait.until(lambda b: b.execute_script("return document.activeElement.shadowRoot?.activeElement"))
    browser.execute_script("window.host = document.activeElement;")
    field.send_keys("poly4d")
    found = "return [...window.host.shadowRoot.querySelectorAll('a')].map((a) => a.href)"
    wait.until(lambda b: any("crazyflie.html" in link for link in b.execute_script(found)))
    assert all(link.startswith("file:") for link in browser.execute_script(found))
    assert complaints(browser) == []


@pytest.mark.slow
@pytest.mark.browser
def test_the_cheat_sheet_prints_on_two_pages(browser: Any, site: Path) -> None:
    open_page(browser, site / "cheat_sheet.html")
    a4 = {"paperWidth": 8.27, "paperHeight": 11.69, "preferCSSPageSize": True}
    printed = base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", a4)["data"])
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) == 2
