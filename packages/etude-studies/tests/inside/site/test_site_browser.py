"""The site in a real browser: silent console, plots drawn, filters that filter, no wider than a phone."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from made_up_study import small_study

from chromium import chromium, complaints, empty_plots, open_page, overhang
from etude_studies.site import facets
from etude_studies.site.build import build_site
from etude_studies.site.words import WORDS
from etude_studies.thesis.verdict_file import shown

pytestmark = pytest.mark.browser

LISTED = (
    "return [...document.querySelectorAll('ul.claims > li')].filter((li) => li.offsetHeight > 0)"
    ".map((li) => li.querySelector('a').textContent)"
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    ledger, results, verdicts = small_study()
    return build_site(ledger, verdicts, results, tmp_path_factory.mktemp("site"), what={}).parent


def names(folder: Path) -> list[str]:
    """All pages but most of those that are made alike: a fourth of the claims', and two runs'."""
    found = sorted(path.name for path in folder.glob("*.html"))
    claims, runs = ([name for name in found if name.startswith(start)] for start in ("C", "run-"))
    alike = {*claims, *runs} - {*claims[::4], "run-A1.html", "run-DP4.html"}
    return [name for name in found if name not in alike]


def press(browser: Any, facet: str, value: str) -> None:
    browser.execute_script(
        "document.querySelector(`button[data-facet='${arguments[0]}'][data-value='${arguments[1]}']`).click()",
        facet,
        value,
    )


def filtered(browser: Any, every: int) -> list[str]:
    """The claims listed, once they are fewer than all: the page hears of a new address some time after it."""
    from selenium.webdriver.support.ui import WebDriverWait

    return list(
        WebDriverWait(browser, 60).until(
            lambda b: 0 < len(b.execute_script(LISTED)) < every and b.execute_script(LISTED)
        )
    )


def test_on_a_phone_no_page_complains_or_overflows_and_every_plot_is_drawn(browser: Any, site: Path) -> None:
    drawn = 0
    for name in names(site):
        open_page(browser, site / name, 400)
        browser.execute_script("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
        assert overhang(browser) == 0, name
        assert complaints(browser) == [], name
        if places := len(re.findall("<figure", (site / name).read_text(encoding="utf-8"))):
            assert empty_plots(browser, "figure.plot", ".mark") == [], name
            drawn += places
    assert drawn > 40


@pytest.mark.parametrize(
    ("name", "plots"),
    [
        ("table-6.9.html", ["dots mean", "curves mean", "seeds"]),
        ("figure-6.11.html", ["curves mean", "seeds"]),
        ("table-6.2.html", ["dots all", "seeds"]),
        ("figure-6.13.html", ["trace waist", "trace wrist"]),
        ("C6.2-2.html", ["estimates 0", "seeds 0"]),
        ("protocols.html", ["dots protocols", "curves protocols"]),
    ],
)
def test_expected_plots_are_there(browser: Any, site: Path, name: str, plots: list[str]) -> None:
    open_page(browser, site / name)
    found = browser.execute_script(
        "return [...document.querySelectorAll('figure.plot')].map((f) => f.dataset.plot)"
    )
    assert {*plots} <= {*found}


def test_a_verdicts_filter_leaves_the_claims_of_that_verdict(browser: Any, site: Path) -> None:
    ledger, _, verdicts = small_study()
    open_page(browser, site / "index.html")
    assert browser.execute_script(LISTED) == [claim.id for claim in ledger.claims]
    press(browser, "verdict", "holds")
    held = [claim.id for claim in ledger.claims if WORDS[shown(verdicts[claim.id])].name == "holds"]
    assert 0 < len(held) < len(ledger.claims)
    assert browser.execute_script(LISTED) == held
    assert f"{len(held)} of {len(ledger.claims)} claims" in browser.page_source
    press(browser, "verdict", "holds")
    assert browser.execute_script(LISTED) == [claim.id for claim in ledger.claims]


def test_filters_of_two_kinds_narrow_each_other_and_values_of_one_widen(browser: Any, site: Path) -> None:
    ledger, _, _ = small_study()
    own = {claim.id: facets.of_claim(ledger, claim) for claim in ledger.claims}
    open_page(browser, site / "index.html")
    press(browser, "robot", "arm")
    press(browser, "motions", "maximum variance")
    designed = [id for id, found in own.items() if "maximum variance" in found["motions"]]
    of_arm = [id for id in designed if "arm" in own[id]["robot"]]
    assert 0 < len(of_arm) < len(designed)
    assert browser.execute_script(LISTED) == of_arm
    press(browser, "robot", "quadrotor")
    of_both = [id for id in designed if {"arm", "quadrotor"} & {*own[id]["robot"]}]
    assert len(of_both) > len(of_arm)
    assert browser.execute_script(LISTED) == of_both


def test_the_search_finds_words_of_quotations(browser: Any, site: Path) -> None:
    open_page(browser, site / "index.html")
    browser.find_element("id", "search").send_keys("comparable to using FULL")
    assert browser.execute_script(LISTED) == ["C6.2-3"]
    browser.find_element("id", "clear").click()
    assert len(browser.execute_script(LISTED)) == len(small_study()[0].claims)
    browser.find_element("id", "search").send_keys("variance  Dictionary")
    assert "C6.2-2" in browser.execute_script(LISTED), "words in any order"
    assert len(browser.execute_script(LISTED)) < len(small_study()[0].claims)


def test_a_count_at_the_top_filters_and_the_address_keeps_it(browser: Any, site: Path) -> None:
    open_page(browser, site / "index.html")
    browser.find_element("css selector", "a.count.holds").click()
    held = filtered(browser, len(small_study()[0].claims))
    assert browser.current_url.endswith("#verdict=holds")
    browser.refresh()
    assert filtered(browser, len(small_study()[0].claims)) == held
    assert complaints(browser) == []


def test_without_the_script_every_claim_is_listed_and_no_dead_filter_is_shown(
    browser: Any, site: Path, tmp_path: Path
) -> None:
    plain = tmp_path / "index.html"
    text = (site / "index.html").read_text(encoding="utf-8")
    plain.write_text(text.replace('<script src="site.js"></script>', ""), encoding="utf-8")
    (tmp_path / "style.css").write_bytes((site / "style.css").read_bytes())
    open_page(browser, plain)
    assert len(browser.execute_script(LISTED)) == len(small_study()[0].claims)
    assert browser.execute_script("return document.querySelector('form.filters').offsetHeight") == 0


def test_a_click_unfolds_the_seeds(browser: Any, site: Path) -> None:
    open_page(browser, site / "table-6.9.html")
    seen = "return document.querySelector(\"figure[data-plot='seeds'] svg\").checkVisibility()"
    assert browser.execute_script(seen) is False
    titles = "[...document.querySelectorAll('summary')]"
    browser.execute_script(f"{titles}.find((s) => s.textContent.startsWith('Every seed')).click()")
    assert browser.execute_script(seen) is True


def test_a_result_that_comes_in_renews_the_served_pages(browser: Any, tmp_path: Path) -> None:
    from threading import Thread

    from selenium.webdriver.support.ui import WebDriverWait

    from etude.report import HOST, server
    from etude_studies.thesis.study import STUDY

    with server(STUDY.live({"folder": tmp_path}), 0) as served:
        Thread(target=served.serve_forever, daemon=True).start()
        browser.get(f"http://{HOST}:{served.server_address[1]}/")
        assert browser.execute_script("return document.querySelectorAll('ul.claims > li').length") > 100
        browser.execute_script("window.before = true;")
        (tmp_path / "thesis").mkdir()
        (tmp_path / "thesis" / "new").touch()
        WebDriverWait(browser, 60).until(lambda b: b.execute_script("return !window.before"))
        assert complaints(browser) == []
        served.shutdown()
