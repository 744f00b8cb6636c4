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
        element("a", words, href=where) if where != here else element("b", words) for where, words in pages
    ]
    main = Html(f"<main>\n{element('nav', *links, class_='top')}\n{join(body)}\n</main>")
    style, own = Html('<link rel="stylesheet" href="style.css">'), Html('<script src="site.js"></script>')
    return document(f"{title} · Étude", style, main, own)


def style_sheet() -> str:
    """That of the campaign's report, with what the site adds."""
    report = resources.files("etude.report").joinpath("report.css").read_text(encoding="utf-8")
    return report + _own("style.css")


def script() -> str:
    return _own("site.js")


def chip(verdict: Verdict, words: str = "") -> Html:
    """The verdict's mark and word on its colour; `words` after them."""
    return word_chip(shown(verdict), f" {words}" if words else "")


def word_chip(word: str, after: str = "") -> Html:
    own = WORDS[word]
    mark = element("i", own.mark, **{"aria-hidden": "true"})
    return element("span", mark, f" {word}{after}", class_=f"chip {own.name}", title=own.meaning)


def folded(title: str, *content: object, note: str = "", id_: str = "") -> Html:
    """Content that opens on a click; readable without a script."""
    small = Html(f" <small>{text(note)}</small>") if note else ""
    named = {"id": id_} if id_ else {}
    return element("details", element("summary", title, small), *content, **named)


def command(words: str) -> Html:
    """A command to copy."""
    return element("pre", element("code", words), class_="command")


def link(where: str, words: object) -> Html:
    return element("a", words, href=where)


def file_of(id: str) -> str:
    """The page of an entry, a claim or a run."""
    return f"{id}.html"


def _own(name: str) -> str:
    return resources.files("etude_studies.site").joinpath(name).read_text(encoding="utf-8")
