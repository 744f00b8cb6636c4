"""Every seed as a point on its row's line, the same seed joined from row to row."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from etude.report import Axis, Html, Scale, fitted_scale, number
from etude_studies.site.dot_plot import LEFT, RIGHT, WIDE, ground
from etude_studies.site.marks import Style, drawing, label, sign

ROW = 46.0
Strip = tuple[str, Mapping[int, float], Style, Mapping[str, str]]
"""Name of a row, its numbers by seed, its style, and hashes of its specs by seed."""


def seed_plot(title: str, strips: Sequence[Strip], *, axis: str, centre: float | None = None) -> Html:
    """The drawing; hashes stand in the tips."""
    values = [v for _, by_seed, _, _ in strips for v in by_seed.values() if math.isfinite(v)]
    low, high = min(values), max(values)
    log = centre is None and low > 0.0 and high > WIDE * low
    floor = 0.0 if centre is None and low >= 0.0 and not log else None
    held = np.array([*values, *([] if centre is None else [centre])])
    scale = fitted_scale(Axis(axis, log=log, floor=floor), held, LEFT, RIGHT)
    bottom = 10.0 + ROW * len(strips)
    drawn = [ground(scale, 10.0, bottom, axis, None, centre), _joined(strips, scale)]
    for place, strip in enumerate(strips):
        drawn += _strip(strip, 10.0 + ROW * place, scale)
    return drawing(title, bottom + 44.0, "".join(drawn))


def _joined(strips: Sequence[Strip], scale: Scale) -> str:
    seeds = sorted({seed for _, by_seed, _, _ in strips for seed in by_seed})
    out = []
    for seed in seeds:
        points = [
            (float(scale(by_seed[seed])), _middle(place))
            for place, (_, by_seed, _, _) in enumerate(strips)
            if math.isfinite(by_seed.get(seed, math.nan))
        ]
        if len(points) > 1:
            out.append('<path class="pair" d="M' + "L".join(f"{x:.1f},{y:.1f}" for x, y in points) + '"/>')
    return "".join(out)


def _strip(strip: Strip, top: float, scale: Scale) -> list[str]:
    name, by_seed, style, hashes = strip
    out = [label(LEFT, top + 12, name, "name halo")]
    for seed, value in sorted(by_seed.items()):
        if math.isfinite(value):
            spec = f", spec {hashes[str(seed)]}" if str(seed) in hashes else ""
            tip = f"{name}, seed {seed}: {number(value, 4)}{spec}"
            out.append(sign(style, float(scale(value)), top + 30.0, tip, 3.6))
    return out


def _middle(place: int) -> float:
    return 10.0 + ROW * place + 30.0
