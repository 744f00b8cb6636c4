"""The little HTML the report needs. Text is escaped unless it is already `Html`."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence


class Html(str):
    """A string that is markup already, and is not escaped again."""

    __slots__ = ()


def text(value: object) -> Html:
    """`value` as markup: escaped, unless it is `Html`."""
    return value if isinstance(value, Html) else Html(html.escape(str(value), quote=True))


def join(parts: Iterable[object], separator: str = "\n") -> Html:
    return Html(separator.join(text(part) for part in parts))


def element(tag: str, *content: object, **attributes: object) -> Html:
    """`<tag attributes>content</tag>`; an attribute's trailing underscore is dropped (`class_`)."""
    given = "".join(f' {name.rstrip("_")}="{text(value)}"' for name, value in attributes.items())
    return Html(f"<{tag}{given}>{join(content, '')}</{tag}>")


def paragraph(*content: object, class_: str = "") -> Html:
    return element("p", *content, class_=class_) if class_ else element("p", *content)


def missing(sentence: str) -> Html:
    """What a section says in place of something the campaign does not have yet."""
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
    """How often `unit` goes into `value`, as somebody says it: `18 times`, `5.3 times`."""
    return f"{number(value / unit, 2) if unit > 0 else 'infinitely many'} times"


def duration(seconds: float) -> str:
    """`95 s`, or `4 min 5 s` from two minutes on."""
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if rest else f"{minutes} min"
