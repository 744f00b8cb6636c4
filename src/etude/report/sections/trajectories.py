"""Each trajectory as fractions of its limits, and the certificate that proves them for all times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from etude.report.markup import (
    Html,
    duration,
    element,
    grid,
    join,
    missing,
    number,
    paragraph,
    section,
    table,
)
from etude.report.record import Facts, Record
from etude.report.scales import Axis
from etude.report.sections.learning import joint_style
from etude.report.svg import Level, Line, Mark, panel
from etude.robots.spec import RobotSpec
from etude.trajectories.samples import Trajectory

Array = NDArray[np.float64]

UNITS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s²", "box": "rad"}

Panels = Callable[[Trajectory, RobotSpec], list[Html]]
Proofs = Callable[[Facts], Html]


def trajectories(record: Record) -> Html:
    """One folded part per proposed trajectory, the newest open."""
    text = "Curves are drawn as a fraction of each joint's own limit: the dotted lines at ±1 are the limits."
    return proposals(record, text, limit_panels, _proofs)


def proposals(record: Record, text: str, panels: Panels, proofs: Proofs) -> Html:
    """Every proposal with what `panels` draws of it and `proofs` says of its certificate."""
    motion, motions = record.words.motion, record.words.motions
    title = f"{motions.capitalize()}, their limits and proved margins"
    numbers = [n for n, r in sorted(record.state.rounds.items()) if r.asked is not None]
    if not numbers:
        return section("trajectories", title, missing(f"No {motion} has been proposed yet."))
    proved = (
        "The table gives what is proved of the file as written, for every instant and not only at samples."
    )
    parts = [_proposal(record, n, panels, proofs, unfolded=n == numbers[-1]) for n in reversed(numbers)]
    return section("trajectories", title, paragraph(f"{text} {proved}"), *parts)


def _proposal(record: Record, n: int, panels: Panels, proofs: Proofs, *, unfolded: bool) -> Html:
    trajectory, certificate = record.trajectory(n), record.certificate(n)
    parts = _how(record, n)
    if trajectory is None:
        parts.append(missing(f"The {record.words.motion}'s file is missing or unreadable."))
    elif record.spec is None or record.spec.dof != trajectory.dof:
        robot, motion = record.words.robot, record.words.motion
        parts.append(missing(f"The {robot}'s file does not fit this {motion}, so it cannot be drawn."))
    else:
        parts.append(grid(panels(trajectory, record.spec), 3))
    parts.append(proofs(certificate) if certificate else missing("There is no certificate for it."))
    length = f" · {duration(trajectory.duration)}" if trajectory else ""
    summary = element(
        "summary", f"{record.words.motion.capitalize()} {n}", element("small", length + _verdict(certificate))
    )
    return element("details", summary, *parts, **({"open": "open"} if unfolded else {}))


def _how(record: Record, n: int) -> list[Html]:
    status = (record.state.rounds[n].asked or {}).get("status")
    return [paragraph(f"How it was chosen: {status}.".replace("..", "."), class_="soft")] if status else []


def limit_panels(trajectory: Trajectory, spec: RobotSpec) -> list[Html]:
    """Position, velocity and acceleration of every joint over time, each as a fraction of its limit."""
    samples = trajectory.sample(np.linspace(0.0, trajectory.duration, 301))
    middle, half = 0.5 * (spec.upper + spec.lower), 0.5 * (spec.upper - spec.lower)
    shown = {
        "Position within its range": (samples.q - middle) / half,
        "Velocity / limit": samples.qd / spec.velocity,
        "Acceleration / limit": samples.qdd / spec.acceleration,
    }
    return [fractions(title, samples.t, values, spec.names) for title, values in shown.items()]


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
    uses = [_use(row) for row in certificate.get("rows", ())]
    if not certificate.get("ok"):
        return " · NOT proved inside its limits"
    rest = "; starts and ends at rest" if certificate.get("at_rest") else ""
    most = f"{100.0 * max(uses, default=0.0):.0f}"
    return f" · proved inside all limits, uses up to {most} % of one{rest}"


def _use(row: Facts) -> float:
    half = 0.5 * (row["upper"] - row["lower"])
    return 1.0 - row["margin"] / half if half > 0 else float("inf")


def _proofs(certificate: Facts) -> Html:
    """One row per joint, one column per quantity; how it was proved stands below, once."""
    rows = certificate.get("rows", ())
    joints, quantities = (list(dict.fromkeys(row[key] for row in rows)) for key in ("axis", "quantity"))
    proofs = {(row["axis"], row["quantity"]): _proof(row) for row in rows}
    body = [[joint, *(proofs.get((joint, quantity), "–") for quantity in quantities)] for joint in joints]
    methods = "; ".join(dict.fromkeys(str(row["method"]) for row in rows))
    header = ["joint", *(f"proved {quantity} ({UNITS.get(quantity, '1')})" for quantity in quantities)]
    return join([table(header, body), paragraph(f"Method: {methods}.", class_="soft")])


def _proof(row: Facts) -> Html:
    limit = f"limit {interval(row['lower'], row['upper'])}, margin "
    detail = element("small", limit, margin(row), class_="soft")
    return join([element("b", interval(row["proved_lower"], row["proved_upper"])), meter(row), detail], "")


def interval(low: float, high: float) -> str:
    return f"{low:.4g} … {high:.4g}".replace("-", "−")


def margin(row: Facts) -> Html:
    half = 0.5 * (row["upper"] - row["lower"])
    share = 100.0 * row["margin"] / half if half > 0 else float("nan")
    percent = "< 0.01" if 0.0 <= share < 0.01 else number(share, 2)
    return element("span", f"{percent} %", class_="good" if row["margin"] >= 0 else "bad")


def meter(row: Facts) -> Html:
    """The proved interval drawn inside the limits."""
    width = row["upper"] - row["lower"] or 1.0
    left = 100 * max(0.0, (row["proved_lower"] - row["lower"]) / width)
    right = 100 * max(0.0, (row["upper"] - row["proved_upper"]) / width)
    return element("div", element("i", style=f"left:{left:.1f}%;right:{right:.1f}%"), class_="meter")
