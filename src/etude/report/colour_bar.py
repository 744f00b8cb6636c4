"""The legend of colours: a strip from dark to bright with the values at its ends."""

from __future__ import annotations

import numpy as np

from etude.report.markup import Html, number, text
from etude.report.png import colours, png_address


def colour_bar(low: float, high: float, unit: str, place: tuple[float, float] = (66.0, 26.0)) -> Html:
    """SVG of the strip, its upper left corner at `place` px; 110 px wide, the values on both sides of it."""
    x, y = place
    ramp = png_address(colours(np.linspace(0.0, 1.0, 64)[None, :]))
    return Html(
        f'<text class="tick" x="{x - 6:g}" y="{y + 10:g}" text-anchor="end">{number(low, 2)}</text>'
        f'<image x="{x:g}" y="{y:g}" width="110" height="11" preserveAspectRatio="none" href="{ramp}"/>'
        f'<text class="tick" x="{x + 116:g}" y="{y + 10:g}">{number(high, 2)} {text(unit)}</text>'
    )
