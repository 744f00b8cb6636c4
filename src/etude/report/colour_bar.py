"""The legend of colours: a strip from dark to bright with the values at its ends."""

from __future__ import annotations

import numpy as np

from etude.report.markup import Html, number, text, with_unit
from etude.report.png import STOPS, colours, png_address
from etude.types import Array


def colour_bar(low: float, high: float, unit: str, stops: Array = STOPS) -> Html:
    """SVG of the strip under a panel's title, the values on both sides of it."""
    ramp = png_address(colours(np.linspace(0.0, 1.0, 64)[None, :], stops))
    return Html(
        f'<text class="tick" x="60" y="36" text-anchor="end">{number(low, 2)}</text>'
        f'<image x="66" y="26" width="110" height="11" preserveAspectRatio="none" href="{ramp}"/>'
        f'<text class="tick" x="182" y="36">{text(with_unit(high, unit, 2))}</text>'
    )
