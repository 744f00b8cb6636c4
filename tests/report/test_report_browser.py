"""A campaign's report in a real browser: nothing on the console, everything drawn, no wider than a phone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from synthetic_campaign import write_campaign

from chromium import chromium, complaints, empty_plots, open_page, overhang
from etude.report import build_report

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    write_campaign(folder)
    return build_report(folder)


def test_the_console_is_silent_and_every_panel_has_something_drawn_in_it(browser: Any, report: Path) -> None:
    open_page(browser, report)
    assert browser.title == "Étude report: synthetic <arm>"
    assert empty_plots(browser, "svg.panel", ".line, .dot, rect, image, .track") == []
    assert complaints(browser) == []


def test_a_broken_script_would_be_noticed(browser: Any, report: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.html"
    broken.write_text(report.read_text(encoding="utf-8").replace("const readout", "const const readout"))
    open_page(browser, broken)
    assert any("SyntaxError" in words for words in complaints(browser))


def test_values_are_read_off_a_panel_under_the_pointer(browser: Any, report: Path) -> None:
    open_page(browser, report)
    readout = (
        "return [...document.querySelectorAll('.readout')].map((r) => r.style.display + r.textContent)[0]"
    )
    browser.execute_script(
        "const svg = document.querySelector('svg.panel'); svg.scrollIntoView({block: 'center'});"
        "const box = svg.getBoundingClientRect();"
        "svg.dispatchEvent(new PointerEvent('pointermove', {bubbles: true,"
        " clientX: box.left + box.width * 0.5, clientY: box.top + box.height * 0.5}));"
    )
    x, y = browser.execute_script(readout).removeprefix("block").split(" , ")
    assert float(x) > 0.0
    assert float(y) > 0.0


@pytest.mark.parametrize("width", [400, 1280])
def test_the_page_is_no_wider_than_the_window(browser: Any, report: Path, width: int) -> None:
    open_page(browser, report, width)
    assert overhang(browser) == 0


def test_links_of_the_contents_lead_to_parts_of_the_page(browser: Any, report: Path) -> None:
    open_page(browser, report)
    lost = browser.execute_script(
        "return [...document.querySelectorAll('nav a')].map((a) => a.getAttribute('href'))"
        ".filter((to) => !document.querySelector(to))"
    )
    assert lost == []
