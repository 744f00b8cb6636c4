"""Motion in space before it runs: solid parts, surroundings, swept volume, and distances.

The page needs no network and no library: `space.js` draws with WebGL 2. Distances are those of the
certificate's limits, at the drawn poses. The certificate gives the proved values.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from etude.errors import UsageError, typed
from etude.protocols import Trajectory
from etude.report.markup import Html, document, element, join, number, paragraph, table
from etude.report.motion_in_space import MotionInSpace, in_space
from etude.report.record import Record, read_record
from etude.report.script_data import script_data
from etude.storage import write_atomic

OPEN_ROWS = 6
"""Rows of the certificate that are seen at once, the narrowest first."""
TEXT = (
    "Solid: the robot along {title} as planned. Blue line: the path of {tips}. Pale: the volume that the "
    "robot sweeps. {colour}"
)
COLOUR = (
    "Lines show the least planned distances. Their colour, and that of the parts, shows the distance "
    "beyond the allowed minimum. Neighbouring links have no lines."
)
HULLS = "The page shows the convex hulls that distances are computed for, not the finer meshes."
STICKS = "The description has no shapes, so links are drawn as bars."
MEASURED = "Blue: the robot as measured in its log."
LIVE = (
    "Solid: the robot at its set-point now. Blue: the measured robot. Blue line: the path of {tips} "
    "along {title}. Pale: the volume that the robot sweeps. {colour}"
)
ENLARGED = "It is drawn {times} times as large as in reality."
NO_DISTANCES = "No distance is computed for this robot: collisions are not checked."
AROUND = "Obstacles from the robot's file: {names}."
NOTHING = "The robot's file names no obstacles."
NEAREST = (
    "Least planned distance, without neighbouring links: {pair}, {apart} at {time:.1f} s; at least "
    "{kept} are required."
)
PROVED = (
    "The certificate of this file, the tightest rows first: the limit, and the range proved at all "
    "times, with tracking errors subtracted."
)
ASK_AGAIN = "Write another trajectory before the robot moves: etude ask {folder} --new"
CANNOT = "Name a model file in robot.toml (model_file): URDF or MJCF."
HINT = "Drag: rotate. Shift and drag, or two fingers: move. Wheel: zoom. Double click: reset."
NO_MORE = Html("")
NO_VIEW = "This browser has no WebGL 2, so the motion cannot be shown in space."


def page(
    record: Record, proposal: int, stream: str = "", approach: Trajectory | None = None
) -> tuple[Html, MotionInSpace]:
    """The drawing and its proved distances as a page, and the motion that it shows, after its `approach`.

    Raises:
        UsageError: no such proposal, or the robot cannot be drawn.
    """
    motion = in_space(record, proposal, approach)
    if motion is None:
        raise UsageError(
            f"proposal {proposal} cannot be shown",
            where=str(record.folder),
            next_step=record.notes[-1] if record.notes else CANNOT,
        )
    title = f"{record.robot}: {motion.title}"
    head = element("style", Html(asset("report.css") + asset("space.css")))
    parts = [
        element("h1", title),
        describe_motion(motion, live=bool(stream)),
        element("p", describe_nearest(motion), class_="lead"),
    ]
    if changed := record.changed(f"{motion.folder}/certificate.json"):
        again = ASK_AGAIN.format(folder=typed(record.folder))
        parts.append(paragraph(f"{changed} {again}", class_="news red"))
    parts += [figure_in_space(motion, record, proved(motion), stream)]
    main = Html(f"<main>\n{join(parts)}\n</main>")
    return document(title, head, main, element("script", Html(asset("space.js")))), motion


def write_view(
    folder: Path, proposal: int | None = None, approach: Trajectory | None = None
) -> tuple[Path, int, MotionInSpace]:
    """Writes FOLDER/view.html of a proposal, by default the newest, after its `approach`; returns the path,
    the number and the motion.

    Raises:
        UsageError: no such proposal, or the robot cannot be drawn.
    """
    record = read_record(folder)
    number = newest(record, proposal)
    text, motion = page(record, number, approach=approach)
    path = folder / "view.html"
    write_atomic(path, text.encode("utf-8"))
    return path, number, motion


def newest(record: Record, proposal: int | None = None) -> int:
    """The number of a proposal, by default of the newest. UsageError: there is none."""
    proposals = [n for n, r in sorted(record.state.rounds.items()) if r.asked is not None]
    number = max(proposals, default=0) if proposal is None else proposal
    if number not in proposals:
        step = (
            f"They are {', '.join(map(str, proposals))}."
            if proposals
            else f"etude ask {typed(record.folder)}"
        )
        raise UsageError(
            f"there is no proposal {number}" if proposals else "there is no proposal yet",
            where="--proposal" if proposal is not None else str(record.folder),
            next_step=step,
        )
    return number


def asset(name: str) -> str:
    """A file for pages."""
    return resources.files("etude.report").joinpath(name).read_text(encoding="utf-8")


def figure_in_space(motion: MotionInSpace, record: Record, below: Html = NO_MORE, stream: str = "") -> Html:
    """The drawing with its controls and texts.

    Args:
        motion: the motion. record: of the campaign.
        below: further content; its time buttons work too.
        stream: address of the poses of the real robot; "" without one.
    """
    parts = [
        element(
            "div",
            element(
                "canvas", class_="view", tabindex=0, role="img", **{"aria-label": f"{motion.title} in space"}
            ),
            element("div", class_="labels", **{"aria-hidden": "true"}),
            paragraph(HINT, class_="hint"),
            class_="stage-3d",
        ),
        element("p", NO_VIEW, class_="missing no-view", hidden="hidden"),
        element("div", *_controls(motion), class_="controls", hidden="hidden"),
        below,
        element("script", Html(script_data(motion, record, stream)), type="application/json"),
    ]
    return element("figure", *parts, class_="space")


def describe_motion(motion: MotionInSpace, live: bool = False) -> Html:
    """Sentences about the picture. live: it shows the robot while it moves."""
    tips = "its tip" if len(motion.figure.tips) == 1 else "its tips"
    names = [thing.name for thing in motion.figure.things if thing.kind in ("solid", "plane", "inside")]
    sentences = [
        (LIVE if live else TEXT).format(
            title=motion.title, tips=tips, colour=COLOUR if motion.nearby else ""
        ),
        HULLS if motion.nearby else STICKS if not motion.solids else "",
        MEASURED if motion.measured is not None and not live else "",
        ENLARGED.format(times=motion.enlarged) if motion.enlarged > 1 else "",
        AROUND.format(names=", ".join(names)) if names else NOTHING,
    ]
    return paragraph(" ".join(filter(None, sentences)))


def describe_nearest(motion: MotionInSpace) -> str:
    """A sentence on the least distance."""
    near = motion.nearest
    if near is None:
        return NO_DISTANCES
    apart, margin = (f"{number(1000.0 * near[key])} mm" for key in ("distance", "kept"))
    return NEAREST.format(pair=" and ".join(near["pair"]), apart=apart, time=near["time"], kept=margin)


def proved(motion: MotionInSpace) -> Html:
    """Distances in the certificate, and what it does not cover."""
    if motion.certificate is None:
        return Html("")
    pairs = {" and ".join(pair) for pair in (motion.nearby.pairs if motion.nearby else ())}
    rows = sorted(
        (r for r in motion.certificate["rows"] if r["axis"] in pairs), key=lambda r: float(r["slack"])
    )
    cells = [_cells(row, motion.proved_from) for row in rows]
    header = ("Distance", "kept (mm)", "proved (mm)", "for tracking (mm)", "nearest")
    parts = [paragraph(PROVED), table(header, cells[:OPEN_ROWS])] if cells else []
    if cells[OPEN_ROWS:]:
        more = element("summary", f"{len(cells) - OPEN_ROWS} wider ones")
        parts.append(element("details", more, table(header, cells[OPEN_ROWS:])))
    for title, key in (("To be confirmed", "to_confirm"), ("Not verified", "not_verified")):
        items = [element("li", sentence) for sentence in motion.certificate.get(key) or ()]
        parts += [element("h3", title), element("ul", *items)] if items else []
    return join(parts)


WHERE = re.compile(r"(?:^| )at ([\d.e+-]+) s(?: of the .* at ([\d.e+-]+) s)?$")
"""How a certificate says when something happens: in a piece, and when that began."""


def _cells(row: Mapping[str, Any], began: float) -> list[object]:
    numbers = [number(1000.0 * float(row[key])) for key in ("lower", "proved_lower", "tracking_margin")]
    where, match = str(row.get("where", "")), WHERE.search(str(row.get("where", "")))
    if match is None or " and " not in where:
        return [row["axis"], *numbers, ""]
    moment = began + sum(float(part) for part in match.groups() if part)
    button = element(
        "button", f"{moment:.1f} s", type="button", class_="at", **{"data-time": f"{moment:.4f}"}
    )
    return [row["axis"], *numbers, button]


def _controls(motion: MotionInSpace) -> list[Html]:
    """Controls of the drawing, and tables that the script fills."""
    speeds = [element("option", f"{s:g} times its speed", value=s) for s in (0.1, 0.25, 0.5)]
    speeds += [Html('<option value="1" selected>its own speed</option>')]
    speeds += [element("option", f"{s:g} times its speed", value=s) for s in (2, 4)]
    ends = f'min="0" max="{motion.t[-1]:.6g}" step="any" value="0"'
    slider = Html(f'<input type="range" name="time" {ends} aria-label="time"/>')
    strip = (
        Html('<canvas class="strip" height="8" aria-hidden="true"></canvas>') if motion.nearby else Html("")
    )
    ticked = [("swept", "what is swept"), ("path", "path of the tip")]
    ticked += [("distances", "distances")] if motion.nearby else []
    boxes = [Html(f'<label><input type="checkbox" name="{n}" checked/> {w}</label>') for n, w in ticked]
    joints = element(
        "tr",
        *(element("th", name) for name in ("", "planned")),
        element("th", "measured", class_="measured"),
        element("th", "in its range"),
    )
    return [
        element(
            "div",
            element("button", "Play", type="button", class_="play"),
            element("div", slider, strip, class_="slider"),
            element("output", "0.00 s", class_="time"),
            element("select", *speeds, name="speed", **{"aria-label": "speed"}),
            class_="transport",
        ),
        element("div", *boxes, element("span", "now: ", element("b", "", class_="piece")), class_="asked"),
        element(
            "div",
            element("div", element("h3", "Nearest now"), *_scale(motion)),
            element(
                "div",
                element("h3", "Where it is now"),
                element("table", element("thead", joints), element("tbody"), class_="joints"),
                class_="scroll",
            ),
            class_="beside",
        ),
    ]


def _scale(motion: MotionInSpace) -> list[Html]:
    if motion.nearby is None:
        return [paragraph(NO_DISTANCES, class_="missing")]
    return [
        element("ul", class_="nearest"),
        element("p", "beyond the minimum: 0", element("i"), "100 mm and more", class_="soft scale"),
    ]
