"""Each trajectory as fractions of its limits, its distances, and the certificate that proves them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from etude.codes import stated
from etude.protocols import Limit, Trajectory
from etude.report.markup import (
    Html,
    duration,
    element,
    grid,
    join,
    missing_data,
    number,
    paragraph,
    section,
    table,
    unit_sign,
    with_unit,
)
from etude.report.record import Facts, Record
from etude.report.scales import Axis
from etude.report.scene import Path, room_of, scene
from etude.report.sections.learning import joint_style
from etude.report.sections.paths import through_space
from etude.report.svg import Level, Line, Mark, panel
from etude.types import Array, Proof

SAMPLES = 301  # of a curve: about one for each px
RATES = ("", "/s", "/s²", "/s³")
ORDERS = {"position": 0, "box": 0, "radius": 0, "velocity": 1, "speed": 1, "acceleration": 2, "jerk": 3}
COMMANDED = {"torque": "", "command": "", "torque rate": "/s", "command rate": "/s"}
"""Quantities in the commands' unit."""
FORCES = {"lift": "m/s²", "thrust": "m/s²", "tilt": "rad"}
TEXT = (
    "Curves are drawn as a fraction of each limit: the dotted lines at ±1 are the limits. The table "
    "shows the proved range of the file, for every instant and not only at samples, and the tracking "
    "margin."
)


def trajectories(record: Record) -> Html:
    """One folded part per proposed trajectory, the newest open."""
    title = "Trajectories, their limits and proved ranges"
    numbers = [n for n, r in sorted(record.state.rounds.items()) if r.asked is not None]
    if not numbers:
        return section("trajectories", title, missing_data("No trajectory has been proposed yet."))
    parts = [_proposal(record, n, unfolded=n == numbers[-1]) for n in reversed(numbers)]
    return section("trajectories", title, paragraph(TEXT), *parts)


def _proposal(record: Record, n: int, *, unfolded: bool) -> Html:
    trajectory, certificate = record.trajectory(n), record.certificate(n)
    parts = _selection_paragraph(record, n)
    if trajectory is None:
        parts.append(missing_data("The trajectory's file is missing or unreadable."))
    elif len(record.names) != _dimensions(trajectory):
        parts.append(missing_data("The robot's file does not fit this trajectory, so it cannot be drawn."))
    else:
        parts.append(grid(_panels(record, trajectory), 3))
    parts.append(
        _proofs(record, certificate) if certificate else missing_data("There is no certificate for it.")
    )
    changed = record.changed(f"proposals/{n:04d}/certificate.json") if certificate else ""
    parts += [paragraph(changed, class_="soft")] if changed else []
    length = f" · {duration(trajectory.duration)}" if trajectory else ""
    summary = element("summary", f"Trajectory {n}", element("small", length + _verdict(certificate)))
    return element("details", summary, *parts, **({"open": "open"} if unfolded else {}))


def _dimensions(trajectory: Trajectory) -> int:
    return int(trajectory.motion(np.zeros(1), 1).orders.shape[2])


def _selection_paragraph(record: Record, n: int) -> list[Html]:
    asked = record.state.rounds[n].asked
    status = asked.status if asked else ""
    return [paragraph(f"How it was chosen: {status}.".replace("..", "."), class_="soft")] if status else []


def _panels(record: Record, trajectory: Trajectory) -> list[Html]:
    """The path in its room, where it goes through space; what each limit measures, as parts of that limit."""
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    panels = [p for limit in record.limits if (p := limit_panel(limit, trajectory, t)) is not None]
    if through_space(record) and len(record.names) == 3:
        path = Path(t, trajectory.motion(t, 1).orders[0])
        panels.insert(0, scene("The plan in its room", room_of(record.limits, [path]), [path]))
    return panels


NEAREST = 6
"""Distances that are shown one by one; an arm has dozens."""
FARTHEST = 10.0
"""What is drawn of a distance, in parts of what is to be kept."""


CLEARANCE = "clearance"
"""The quantity of the rows that are distances, in m."""


def use_of_distance(margin: float, proved: float) -> float:
    """Fraction of a proved distance that its margin takes; 1 where the distance equals the margin."""
    return margin / proved if proved > 0.0 else math.inf


def distances(rows: Sequence[Facts]) -> list[Html]:
    """What has no upper end, as distances have none, from a certificate's rows, each quantity by itself."""
    unbounded = [row for row in rows if row["upper"] == math.inf]
    names = dict.fromkeys(row["quantity"] for row in unbounded)
    return [part for name in names for part in _least([row for row in unbounded if row["quantity"] == name])]


def _least(rows: list[Facts]) -> list[Html]:
    """Those of one quantity, the nearest with where and when; an owner's quantity has no known unit."""
    rows.sort(key=lambda row: use_of_distance(row["lower"], row["proved_lower"]), reverse=True)
    quantity = rows[0]["quantity"]
    name, unit = ("distance", "m") if quantity == CLEARANCE else (quantity, "1")
    in_unit = "" if unit == "1" else f" ({unit})"
    header = ["", f"proved {name}{in_unit}", f"to keep{in_unit}", "nearest"]
    body = [
        [
            row["axis"],
            number(row["proved_lower"], 4),
            number(row["lower"], 3),
            "; ".join(filter(None, (row["where"], row.get("note", "")))) or "far",
        ]
        for row in rows[:NEAREST]
    ]
    others = rows[NEAREST:]
    least = min((row["proved_lower"] for row in others), default=0.0)
    more = f"{len(others)} more, all at least {with_unit(least, unit)}."
    return [table(header, body), *([paragraph(more, class_="soft")] if others else [])]


def distance_panel(rows: Sequence[Proof], measured: Array, t: Array) -> Html:
    """Distances (T, n) over time as multiples of what is to be kept, the nearest of them."""
    nearest = np.argsort([row.proved_lower / row.lower for row in rows])[:NEAREST]
    marks: list[Mark] = [
        Line(t, np.minimum(measured[:, i] / rows[i].lower, FARTHEST), rows[i].axis, joint_style(k))
        for k, i in enumerate(nearest)
    ]
    axes = Axis("time (s)", limits=(0.0, float(t[-1]))), Axis("multiple of limit (1)", limits=(0.0, FARTHEST))
    return panel("Clearance / limit", *axes, [*marks, Level(1.0, style="limit")], size=(380, 300))


def limit_panel(limit: Limit, trajectory: Trajectory, t: Array) -> Html | None:
    """What one limit measures along a motion, over time, each row as a fraction of its limit."""
    rows = [row for row in limit.prove(trajectory.pieces()[0][2]) if row.status != "not verified"]
    measured = limit.of_motion(trajectory.motion(t, 4))
    if not rows or measured.shape[1] != len(rows):
        return None
    if all(row.upper == np.inf and row.lower > 0.0 for row in rows):
        return distance_panel(rows, measured, t)
    if not all(np.isfinite([row.lower, row.upper]).all() for row in rows):
        return None  # of a limit with one end nothing is a part of it
    low, high = (np.array([getattr(row, end) for row in rows]) for end in ("lower", "upper"))
    # a size has no lower end that could be met: it is drawn from zero
    signed = not bool(np.all(measured >= 0.0) and np.all((low <= 0.0) | ~np.isfinite(low)))
    middle, half = (0.5 * (high + low), 0.5 * (high - low)) if signed else (0.0 * high, high)
    names = tuple(row.axis if len(rows) > 1 else row.quantity for row in rows)
    title = f"{rows[0].quantity.capitalize()} / limit"
    return fractions(title, t, (measured - middle) / half, names, signed=signed)


def fractions(title: str, t: Array, values: Array, names: tuple[str, ...], *, signed: bool = True) -> Html:
    """Values (T, n) over time as fractions of their limits; without a sign the axis starts at 0."""
    marks: list[Mark] = [Line(t, values[:, j], name, joint_style(j)) for j, name in enumerate(names)]
    marks += [Level(limit, style="limit") for limit in ((1.0, -1.0) if signed else (1.0,))]
    bound = max(1.15, 1.05 * float(np.abs(values).max()))
    least = -bound if signed else 0.0
    axes = Axis("time (s)", limits=(0.0, float(t[-1]))), Axis("fraction of limit (1)", limits=(least, bound))
    return panel(title, *axes, marks, size=(380, 300))


def _verdict(certificate: Facts | None) -> str:
    if not certificate:
        return ""
    uses = [_utilization(row) for row in certificate["rows"] if row["status"] != "not verified"]
    if not certificate.get("ok"):
        return " · NOT proved inside its limits"
    at_rest = "; starts and ends at rest" if certificate.get("at_rest") else ""
    most = f"{100.0 * max(uses, default=0.0):.0f}"
    return f" · proved inside all limits, uses up to {most} % of one{at_rest}"


def _utilization(row: Facts) -> float:
    if row["upper"] == math.inf:
        return use_of_distance(row["lower"], row["proved_lower"])
    half = 0.5 * (row["upper"] - row["lower"])
    return 1.0 - row["slack"] / half if half > 0 else float("inf")


def _proofs(record: Record, certificate: Facts) -> Html:
    """One row per axis, one column per quantity; how it was proved stands below, once, and what was not."""
    every = [row for row in certificate["rows"] if row["status"] != "not verified"]
    rows = [row for row in every if row["upper"] != math.inf]
    axes, quantities = (list(dict.fromkeys(row[key] for row in rows)) for key in ("axis", "quantity"))
    # pieces of a chain may have rows of their own: the tightest is shown
    proofs = {(row["axis"], row["quantity"]): _proof(row) for row in sorted(rows, key=_utilization)}
    body = [[axis, *(proofs.get((axis, quantity), "–") for quantity in quantities)] for axis in axes]
    methods = "; ".join(dict.fromkeys(str(row["method"]) for row in every))
    header = ["", *(f"asked {quantity} ({_unit(record, quantity)})" for quantity in quantities)]
    notices = stated(certificate.get("warnings", ()))
    warnings = [paragraph(str(notice), class_="alert") for notice in notices]
    details = *distances(every), *_swept_table(certificate)
    proved = table(header, body), *details, paragraph(f"Method: {methods}.", class_="soft")
    parts = [*warnings, *proved]
    unverified = [str(sentence) for sentence in certificate.get("not_verified", ())]
    if unverified:
        parts.append(missing_data(f"Not verified: {' '.join(unverified)}"))
    return join(parts)


def _swept_table(certificate: Facts) -> list[Html]:
    """What part of each axis's range its segments go through; nothing of certificates that do not say."""
    body = [
        [str(row["axis"]), *(f"{100.0 * row[of]:.0f} %" for of in ("of_range", "of_clear")), str(row["held"])]
        for row in certificate.get("swept", ())
    ]
    header = ["", "share of the range swept", "share of the collision-free range", "limited by"]
    return [table(header, body)] if body else []


def _unit(record: Record, quantity: str) -> str:
    """Of a proved quantity, from the unit of the path."""
    if quantity in FORCES:
        return FORCES[quantity]
    if quantity in COMMANDED:
        return (record.unit or "unit of the axis") + COMMANDED[quantity]
    units = set(record.path.units) if record.path else set()
    if quantity not in ORDERS or len(units) != 1:
        return "1" if not units else "unit of the axis"
    return unit_sign(units.pop()) + RATES[ORDERS[quantity]]


def _proof(row: Facts) -> Html:
    """What is asked, what tracking may add, and the limit of both."""
    margin, sure = row["tracking_margin"], row["confidence"]
    how = "assumed" if sure == 0.0 else f"{100.0 * sure:.0f} % confidence"
    under = f" under {row['control']}" if row.get("control") else ""
    tracked = (
        "" if margin == 0.0 else f"tracking margin{under} {margin:.3g}{f' ({how})' if sure < 1.0 else ''}, "
    )
    limit = f"{tracked}limit {interval(row['lower'] - margin, row['upper'] + margin)}, left "
    detail = element("small", limit, slack(row), class_="soft")
    return join([element("b", interval(row["proved_lower"], row["proved_upper"])), meter(row), detail], "")


def interval(low: float, high: float) -> str:
    return f"{low:.4g} … {high:.4g}".replace("-", "−")


def slack(row: Facts) -> Html:
    half = 0.5 * (row["upper"] - row["lower"])
    share = 100.0 * row["slack"] / half if half > 0 else float("nan")
    percent = "< 0.01" if 0.0 <= share < 0.01 else number(share, 2)
    return element("span", f"{percent} %", class_="good" if row["slack"] >= 0 else "bad")


def meter(row: Facts) -> Html:
    """The proved interval drawn inside the limits."""
    width = row["upper"] - row["lower"] or 1.0
    left = 100 * max(0.0, (row["proved_lower"] - row["lower"]) / width)
    right = 100 * max(0.0, (row["upper"] - row["proved_upper"]) / width)
    return element("div", element("i", style=f"left:{left:.1f}%;right:{right:.1f}%"), class_="meter")
