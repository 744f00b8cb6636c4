"""The frame of every page, and what several pages share: chips, sentences that fold, commands."""

from __future__ import annotations

from importlib import resources

from etude.report import Html, document, element, join, text
from etude_studies.site.words import WORDS
from etude_studies.thesis.verdict_file import shown
from etude_studies.thesis.verdicts import Verdict

INDEX, PROTOCOLS, ABOUT = "index.html", "protocols.html", "about.html"
SOURCE = (
    "S. Wiratunga, Training Gaussian Process Regression models using optimized trajectories, Waterloo 2014"
)
LINKS = ((INDEX, "All claims"), (f"{INDEX}#tables", "Tables and figures"), (PROTOCOLS, "Two protocols"))


def page(title: str, *body: object, here: str = "") -> Html:
    """A whole document; `here` is its file, which the row of links does not link to."""
    pages = (*LINKS, (ABOUT, "How to read"))
    links = [
        element("a", caption, href=where) if where != here else element("b", caption)
        for where, caption in pages
    ]
    main = Html(f"<main>\n{element('nav', *links, class_='top')}\n{join(body)}\n</main>")
    style, script_tag = (
        Html('<link rel="stylesheet" href="style.css">'),
        Html('<script src="site.js"></script>'),
    )
    return document(f"{title} · Étude", style, main, script_tag)


def style_sheet() -> str:
    """That of the campaign's report, with what the site adds."""
    report = resources.files("etude.report").joinpath("report.css").read_text(encoding="utf-8")
    return report + _asset("style.css")


def script() -> str:
    return _asset("site.js")


def chip(verdict: Verdict, suffix: str = "") -> Html:
    """The verdict's mark and word on its colour; `suffix` after them."""
    return word_chip(shown(verdict), f" {suffix}" if suffix else "")


def word_chip(word: str, after: str = "") -> Html:
    term = WORDS[word]
    mark = element("i", term.mark, **{"aria-hidden": "true"})
    return element("span", mark, f" {word}{after}", class_=f"chip {term.name}", title=term.meaning)


def folded(title: str, *content: object, note: str = "", id_: str = "") -> Html:
    """Content that opens on a click; readable without a script."""
    small = Html(f" <small>{text(note)}</small>") if note else ""
    named = {"id": id_} if id_ else {}
    return element("details", element("summary", title, small), *content, **named)


def command(line: str) -> Html:
    """A command to copy."""
    return element("pre", element("code", line), class_="command")


def link(where: str, content: object) -> Html:
    return element("a", content, href=where)


def file_of(id: str) -> str:
    """The page of an entry, a claim or a run."""
    return f"{id}.html"


def _asset(name: str) -> str:
    return resources.files("etude_studies.site").joinpath(name).read_text(encoding="utf-8")
