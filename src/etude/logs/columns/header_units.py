"""Units in headers, in all common spellings: dimension and factor to SI.

`rad/s`, `rad s^-1`, `radians per second` and `rad*s-1` are one unit. A product is written with a blank, a
point, a star or a hyphen (`N-m`). Counts have no factor, since it depends on the drive.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

GRAVITY = 9.81
"""m/s^2."""
DEGREE = math.pi / 180.0
UNITS_TO_USE = "Use rad, rad/s, rad/s^2, deg, deg/s, rpm, m, m/s, m/s^2, g, N m, A, V, % or pwm."


class Dimension(NamedTuple):
    """Exponents."""

    rad: int = 0
    m: int = 0
    s: int = 0
    kg: int = 0
    A: int = 0
    V: int = 0
    counts: int = 0


class Unit(NamedTuple):
    """A unit's factor to SI and its dimension; the factor of counts is 1."""

    factor: float
    dimension: Dimension

    @property
    def counted(self) -> bool:
        """Whether its size in SI depends on the drive."""
        return self.dimension.counts != 0


NUMBER = Dimension()
ANGLE, LENGTH, TIME = Dimension(rad=1), Dimension(m=1), Dimension(s=1)
FORCE, TORQUE = Dimension(m=1, s=-2, kg=1), Dimension(m=2, s=-2, kg=1)
POUND, INCH = 4.4482216152605, 0.0254  # N, m


def _all(spellings: str, factor: float, dimension: Dimension) -> dict[str, Unit]:
    return dict.fromkeys(spellings.split(), Unit(factor, dimension))


BASES: Mapping[str, Unit] = {
    **_all("rad radian radians", 1.0, ANGLE),
    **{"mrad": Unit(1e-3, ANGLE), "urad": Unit(1e-6, ANGLE)},
    **_all("deg degs degree degrees ° º", DEGREE, ANGLE),
    **_all("rev revs revolution revolutions turn turns rot", 2.0 * math.pi, ANGLE),
    **_all("radps", 1.0, Dimension(rad=1, s=-1)),
    **_all("dps degps", DEGREE, Dimension(rad=1, s=-1)),
    **_all("rpm", math.pi / 30.0, Dimension(rad=1, s=-1)),
    **_all("s sec secs second seconds", 1.0, TIME),
    **_all("ms msec", 1e-3, TIME),
    **_all("min minute minutes", 60.0, TIME),
    **_all("m meter meters metre metres", 1.0, LENGTH),
    **{"cm": Unit(1e-2, LENGTH), "mm": Unit(1e-3, LENGTH), "um": Unit(1e-6, LENGTH)},
    **_all("in inch", INCH, LENGTH),
    **_all("ft foot", 12.0 * INCH, LENGTH),
    **_all("n newton newtons", 1.0, FORCE),
    **{"mn": Unit(1e-3, FORCE), "kn": Unit(1e3, FORCE)},
    **_all("kg kgf kp", GRAVITY, FORCE),
    **_all("lb lbs lbf", POUND, FORCE),
    **_all("oz ozf", POUND / 16.0, FORCE),
    **_all("nm newtonmeter newtonmeters newtonmetre newtonmetres", 1.0, TORQUE),
    **{"mnm": Unit(1e-3, TORQUE), "nmm": Unit(1e-3, TORQUE), "knm": Unit(1e3, TORQUE)},
    **{"ncm": Unit(1e-2, TORQUE), "cnm": Unit(1e-2, TORQUE)},
    **_all("g", GRAVITY, Dimension(m=1, s=-2)),
    **_all("mg", 1e-3 * GRAVITY, Dimension(m=1, s=-2)),
    **_all("a amp amps ampere amperes", 1.0, Dimension(A=1)),
    **_all("ma", 1e-3, Dimension(A=1)),
    **_all("v volt volts", 1.0, Dimension(V=1)),
    **_all("mv", 1e-3, Dimension(V=1)),
    **_all("1 pwm pu norm normalized normalised", 1.0, NUMBER),
    **{"%": Unit(1e-2, NUMBER), "‰": Unit(1e-3, NUMBER)},
    **_all("count counts cnt cnts tick ticks raw lsb inc incs increments", 1.0, Dimension(counts=1)),
    **_all("unit units digit digits pulse pulses adc", 1.0, Dimension(counts=1)),
}
"""Lower-case spellings. Of several words, `kg cm` is a torque, as drives of small servos have it."""

WRITTEN = (
    (r"\bper[ _]?(mille|thousand|mil)\b|\bpro ?mille\b|\bpermille\b", "‰"),
    (r"\bper[ _]?cent\b|\bpct\b", "%"),
    (r"(?<=[%‰]).*\b(rated|nominal|maximum|max|limit)\b.*", ""),
    (r"\brms\b|\bpeak\b", ""),
    (r"\bper\b", "/"),
    (r"\*\*", "^"),
)
"""Words and their signs, in this order."""
HIGH = str.maketrans({"²": "^2", "³": "^3", "⁻": "^-", "¹": "1", "−": "-", "μ": "u", "µ": "u"})
TOKEN = re.compile(r"[\s*·⋅∙•×._-]*(/?)\s*([a-z°º%‰]+|1)(?:\^?\{?([-+]?\d)\}?)?\s*")


@lru_cache(maxsize=1024)
def unit_in(text: str) -> Unit | None:
    """The unit of a text such as `rad/sec`; None if it is not a unit. "": a plain number."""
    text = text.strip().lower().translate(HIGH).replace("^-^", "^-")
    for pattern, sign in WRITTEN:
        text = re.sub(pattern, sign, text)
    text, at = text.strip(" -"), 0  # [-] is a number
    factor, exponents = 1.0, [0] * len(NUMBER)
    while at < len(text):
        match = TOKEN.match(text, at)
        base = BASES.get(match[2]) if match else None
        if match is None or base is None or (match[2] == "1" and match[3]):
            return None
        power = int(match[3] or 1) * (-1 if match[1] else 1)
        factor *= base.factor**power
        exponents = [e + power * exponent for e, exponent in zip(exponents, base.dimension, strict=True)]
        at = match.end()
    return Unit(factor, Dimension(*exponents))


def same_dimension(one: str, other: str) -> bool:
    """Whether values in one unit can be converted to the other."""
    a, b = unit_in(one), unit_in(other)
    return a is not None and b is not None and a.dimension == b.dimension
