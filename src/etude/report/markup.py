"""HTML of the report, escaped unless it is `Html`, and the terms of the page."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


class Html(str):
    """A string of markup, which is not escaped again."""

    __slots__ = ()


def text(value: object) -> Html:
    """`value` as markup: escaped, unless it is `Html`."""
    return value if isinstance(value, Html) else Html(html.escape(str(value), quote=True))


def join(parts: Iterable[object], separator: str = "\n") -> Html:
    return Html(separator.join(text(part) for part in parts))


def element(tag: str, *content: object, **attributes: object) -> Html:
    """`<tag attributes>content</tag>`; an attribute's trailing underscore is dropped (`class_`)."""
    rendered = "".join(f' {name.rstrip("_")}="{text(value)}"' for name, value in attributes.items())
    return Html(f"<{tag}{rendered}>{join(content, '')}</{tag}>")


def document(title: str, head: object, *body: object) -> Html:
    """A whole page with `head` in its head, below the title, and `body` in its body."""
    meta = '<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">'
    icon = '<link rel="icon" href="data:,">'  # none, so that no server is asked for one
    top = join([Html(meta), Html(icon), element("title", title), head])
    return Html(
        f'<!doctype html>\n<html lang="en">\n<head>\n{top}\n</head>\n<body>\n{join(body)}\n</body>\n</html>\n'
    )


def paragraph(*content: object, class_: str = "") -> Html:
    return element("p", *content, class_=class_) if class_ else element("p", *content)


def missing_data(sentence: str) -> Html:
    """Sentence of a section in place of missing data."""
    return paragraph(sentence, class_="missing")


def section(identifier: str, title: str, *content: object) -> Html:
    return element("section", element("h2", title), join(content), id=identifier)


def grid(panels: Iterable[object], columns: int = 2) -> Html:
    return element("div", join(panels), class_=f"grid columns-{columns}")


def table(header: Sequence[object], rows: Iterable[Sequence[object]], highlight: int | None = None) -> Html:
    """A table; cells that hold numbers are right-aligned, row `highlight` is set in bold."""
    head = element("tr", *(element("th", cell, scope="col") for cell in header))
    body = [
        element("tr", *map(_cell, row), **({"class_": "chosen"} if index == highlight else {}))
        for index, row in enumerate(rows)
    ]
    return element("div", element("table", element("thead", head), element("tbody", *body)), class_="scroll")


def _cell(value: object) -> Html:
    if isinstance(value, float | int) and not isinstance(value, bool):
        return element("td", number(float(value)), class_="number")
    numeric = isinstance(value, str) and value[:1] in set("0123456789-−+[–")
    return element("td", value, class_="number") if numeric else element("td", value)


def number(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits and no exponent in the range a person reads."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -4 or size > 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:,.{max(0, digits - 1 - size)}f}".replace("-", "−")


def with_unit(value: float | None, unit: str, digits: int = 3) -> str:
    """A number with its unit: `0.131°` for "deg", `0.071 m` for "m", the bare number for "1"."""
    return number(value, digits) + {"deg": "°", "1": ""}.get(unit, f" {unit}")


def times(value: float, unit: float) -> str:
    """The ratio of `value` to `unit` in words: `18 times`, `5.3 times`."""
    return f"{number(value / unit, 2) if unit > 0 else 'infinitely many'} times"


def duration(seconds: float) -> str:
    """`95 s`, or `4 min 5 s` from two minutes on."""
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    minutes, remainder = divmod(round(seconds), 60)
    return f"{minutes} min {remainder} s" if remainder else f"{minutes} min"


@dataclass(frozen=True)
class Baseline:
    """A controller for comparison with the learned one.

    Attributes:
        name: on a curve.
        style: class of its colour.
        card: text under its number on the first screen.
        sentence: of the headline, with places for {error} and {relation}.
    """

    name: str
    style: str
    card: str
    sentence: str


BASELINES = {
    "pd": Baseline("PD alone", "c2", "with PD alone", "PD control alone has {error} ({relation})."),
    "pid": Baseline("PID alone", "c2", "with PID alone", "PID control alone has {error} ({relation})."),
    "rigid_body": Baseline(
        "identified physics",
        "c5",
        "with identified physics",
        "Identified physics alone has {error} ({relation}).",
    ),
    "online": Baseline(
        "learning on line",
        "c4",
        "with online learning",
        "The model with online learning during the test has {error} ({relation}).",
    ),
    "perfect": Baseline(
        "perfect model",
        "c3",
        "with a perfect model",
        "A perfect model of this robot has {error}, which is about the floor.",
    ),
    "analytic": Baseline(
        "analytic, no drag",
        "c5",
        "with the analytic model without drag",
        "The analytic inverse model without drag has {error} ({relation}),",
    ),
    "exact_drag": Baseline(
        "analytic, exact linear drag",
        "c3",
        "with the exact linear drag",
        "and with the exact linear drag {error} ({relation}).",
    ),
}
"""In the order in which they are told of."""
FEEDBACK = ("pd", "pid")
"""Baselines without any feedforward: where the first round starts from."""

TESTS = {
    "fourier": "a smooth Fourier test motion",
    "moves": "point-to-point moves",
    "uniform": "a random test flight",
    "boundary": "a test flight at the edge of its limits",
}

TITLES = {"fourier": "smooth Fourier test motion"}
"""Where a title has another word than a sentence."""

QUANTITIES = {"deg": "tracking error (degrees)", "m": "position error (m)"}


def baseline(name: str) -> Baseline:
    """The description of a baseline; an unknown one is called by its name."""
    plain = name.replace("_", " ")
    unknown = Baseline(plain, "c7", f"with {plain}", f"The baseline {plain} has {{error}} ({{relation}}).")
    return BASELINES.get(name, unknown)


def ordered_baselines(names: list[str]) -> list[str]:
    """Known baselines first, in their order; then the others."""
    return [n for n in BASELINES if n in names] + [n for n in names if n not in BASELINES]


def error_axis(unit: str) -> str:
    """Title of an axis of tracking errors in that unit."""
    return QUANTITIES.get(unit, f"tracking error ({unit})")


def test_name(name: str) -> str:
    """Name of a test motion in a sentence."""
    return TESTS.get(name, f"the test “{name}”")


def test_title(name: str) -> str:
    """Name of a test motion in a title."""
    return TITLES.get(name, TESTS.get(name, name))


def unit_sign(unit: str) -> str:
    """Sign of a unit on the page."""
    return {"deg": "°", "1": ""}.get(unit, unit.replace("^2", "²").replace("^3", "³"))
