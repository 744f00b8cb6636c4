"""Mathematics between dollars, as the thesis writes it: MathML for pages, plain letters elsewhere."""

from __future__ import annotations

import re

from etude.report import Html, element, join

ATOM = re.compile(r"([A-Za-z]|[\d.]+|\S)(?:\^(?:\{([^}]*)\}|(\S)))?")
"""A letter, a number or a sign, and the power that it is raised to."""
POWER = re.compile(r"\^\{?([\d-]+)\}?")
RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def prose(source: str) -> Html:
    """Words whose $formulas$ a browser draws by itself: no script, no fonts, no network."""
    parts = source.split("$")
    return join([element("math", *_row(part)) if i % 2 else part for i, part in enumerate(parts)], "")


def plain(source: str) -> str:
    """The same for a terminal or Markdown: "$O(nm^2)$" as "O(nm²)"."""
    parts = source.split("$")
    return "".join(
        POWER.sub(lambda match: match[1].translate(RAISED), part) if i % 2 else part
        for i, part in enumerate(parts)
    )


def _row(formula: str) -> list[Html]:
    return [_atom(base, braced or power) for base, braced, power in ATOM.findall(formula)]


def _atom(base: str, power: str) -> Html:
    kind = "mi" if base.isalpha() else "mn" if base[0].isdigit() else "mo"
    node = element(kind, base)
    return element("msup", node, element("mrow", *_row(power))) if power else node
