"""A real browser without a window, for tests of pages; a test is skipped where there is none."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

BROWSER, DRIVER = "chromium", "chromedriver"
REQUIRED = "ETUDE_BROWSER_REQUIRED"
"""Of the environment: set by CI, where a skipped test of pages would be a gap."""
INSTALL = "apt-get install -y chromium chromium-driver"
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@contextmanager
def chromium() -> Iterator[Any]:
    """A selenium driver of a fresh profile, its console kept. Skips where there is none, unless required."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="pip install '.[test]'")
    binary, driver = shutil.which(BROWSER), shutil.which(DRIVER)
    if binary is None or driver is None:
        if os.environ.get(REQUIRED):
            pytest.fail(f"there is no browser, and {REQUIRED} says there must be one: {INSTALL}")
        pytest.skip(f"there is no browser: {INSTALL}")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = binary
        for flag in (*FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(executable_path=driver))
        try:
            yield opened
        finally:
            opened.quit()


def open_page(browser: Any, page: Path, width: int = 1280, height: int = 900) -> None:
    """Opens a file in a window of exactly that many px, which a headless window itself does not promise."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get(page.as_uri())


SLOW = "GPU stall due to ReadPixels"
"""A machine without a graphics card says so whenever it shows a picture in space."""


def complaints(browser: Any) -> list[str]:
    """What the console says since it was last asked; nothing of a sound page."""
    return [entry["message"] for entry in browser.get_log("browser") if SLOW not in entry["message"]]


def overhang(browser: Any) -> int:
    """By how many px the page is wider than the window."""
    width = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    return int(browser.execute_script(f"return {width}"))


def empty_plots(browser: Any, where: str, mark: str) -> list[str]:
    """Places of drawings without a drawing, or with nothing drawn in it."""
    found = browser.execute_script(
        "return [...document.querySelectorAll(arguments[0])].map((place) => {"
        "  const svg = place.matches('svg') ? place : place.querySelector('svg');"
        "  const marks = svg ? svg.querySelectorAll(arguments[1]) : [];"
        "  const drawn = [...marks].some((m) => { const b = m.getBBox(); return b.width + b.height > 0; });"
        "  return [place.dataset.plot || (svg && svg.getAttribute('aria-label')) || '?', drawn];"
        "});",
        where,
        mark,
    )
    assert found, f"no place {where}"
    return [name for name, drawn in found if not drawn]
