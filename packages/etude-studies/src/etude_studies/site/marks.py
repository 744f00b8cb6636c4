"""Signs of the drawings: a shape and a dash for every series beside its colour, hollow diamonds for print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from etude.report import Html, element, join, text

WIDTH = 400
"""Of a drawing in px: the width of a phone, so that its type stays legible there."""
SHAPES = ("circle", "square", "triangle", "cross")
DASHES = ("", "dash", "dots", "dashdot")


@dataclass(frozen=True)
class Style:
    """How one series looks. `colour` is a class of the style sheet; the shape "band" is a region."""

    colour: str
    shape: str
    dash: str


def style_of(index: int) -> Style:
    """The style of the series with that number, from 0; colours end after six, shapes and dashes go round."""
    return Style(f"c{1 + index % 6}", SHAPES[index % len(SHAPES)], DASHES[index % len(DASHES)])


def sign(style: Style, x: float, y: float, tip: str = "", size: float = 4.5) -> str:
    """The mark of a series at (x, y) px; `tip` is shown under the pointer."""
    return _mark(_outline(style.shape, x, y, size), f"dot mark {style.colour}", tip)


def printed_sign(x: float, y: float, tip: str = "", colour: str = "", size: float = 5.0) -> str:
    """The hollow diamond of a printed number, in the colour of its series where several lie together."""
    corners = f"M{x:.1f},{y - size:.1f}l{size:g},{size:g}l{-size:g},{size:g}l{-size:g},{-size:g}z"
    return _mark(corners, f"printed mark {colour}".rstrip(), tip)


def whisker(style: Style, x0: float, x1: float, y: float) -> str:
    """A horizontal interval."""
    return f'<path class="line whisker mark {style.colour}" d="M{x0:.1f},{y:.1f}H{x1:.1f}"/>'


def label(x: float, y: float, content: str, class_: str = "name", anchor: str = "start") -> str:
    """Text on a drawing."""
    return f'<text class="{class_}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{text(content)}</text>'


def drawing(title: str, height: float, content: str, width: int = WIDTH) -> Html:
    """An svg of that size whose name is `title`."""
    head = f'<svg class="panel" viewBox="0 0 {width} {height:.0f}" role="img" aria-label="{text(title)}">'
    return Html(f"{head}{content}</svg>")


def figure(name: str, drawn: Html, caption: object = "") -> Html:
    """A drawing in its place on a page; `name` says what is expected there."""
    below = element("figcaption", caption) if caption else ""
    return Html(f'<figure class="plot" data-plot="{text(name)}">{drawn}{below}</figure>')


def legend(
    series: Sequence[tuple[str, Style]], *, printed: bool = False, lines: Sequence[tuple[str, str]] = ()
) -> Html:
    """Names of the series under a drawing, as text of the page, which wraps on a phone.

    Args:
        series: names and styles. printed: whether there are diamonds.
        lines: letters and names of other lines.
    """
    items = [_entry(_swatch(style), name) for name, style in series]
    if printed:
        items.append(_entry(printed_sign(14, 7), "printed in the thesis, one run"))
    items += [_entry('<path class="line base" d="M2,7h24"/>', f"{sign}  {name}") for sign, name in lines]
    return element("ul", join(items), class_="legend")


def _entry(drawn: str, name: str) -> Html:
    swatch = Html(f'<svg class="swatch" viewBox="0 0 28 14" aria-hidden="true">{drawn}</svg>')
    return element("li", swatch, name)


def _swatch(style: Style) -> str:
    if style.shape == "band":
        return f'<rect class="ci bounds {style.colour}" x="1" y="1" width="26" height="12"/>'
    line = f'<path class="line {style.colour} {style.dash}" d="M1,7h26"/>'
    return line + sign(style, 14, 7)


def _outline(shape: str, x: float, y: float, size: float) -> str:
    s = size
    if shape == "square":
        return f"M{x - s:.1f},{y - s:.1f}h{2 * s:g}v{2 * s:g}h{-2 * s:g}z"
    if shape == "triangle":
        return f"M{x:.1f},{y - 1.2 * s:.1f}l{1.2 * s:g},{2.1 * s:g}h{-2.4 * s:g}z"
    if shape == "cross":
        a = 0.45 * s
        return (
            f"M{x - a:.1f},{y - s:.1f}h{2 * a:g}v{s - a:g}h{s - a:g}v{2 * a:g}h{a - s:g}v{s - a:g}h{-2 * a:g}"
            f"v{a - s:g}h{a - s:g}v{-2 * a:g}h{s - a:g}z"
        )
    return f"M{x - s:.1f},{y:.1f}a{s:g},{s:g} 0 1 0 {2 * s:g},0a{s:g},{s:g} 0 1 0 {-2 * s:g},0z"


def _mark(path: str, class_: str, tip: str) -> str:
    shown = f"<title>{text(tip)}</title>" if tip else ""
    return f'<path class="{class_}" d="{path}">{shown}</path>'
