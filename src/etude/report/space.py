"""A motion in space before it moves: solid parts, what stands around, what is swept, and how near all come.

The page needs no network and no library: `space.js` draws with WebGL 2. Distances are those of the limits
that the certificate rests on, at the poses that are drawn. What is proved is quoted from the certificate.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import resources
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from etude.abilities import SupportsNearby, SupportsSolids
from etude.errors import UsageError
from etude.report.markup import Html, document, element, join, number, paragraph, table
from etude.report.record import Facts, Record
from etude.report.scales import linear_ticks
from etude.report.scene import EYE, Path, SceneBox, faces_in, room_of, things_of
from etude.report.sections.motion import figure_along, room_around
from etude.types import Array, Figure, Mask, Motion, Nearby, Solid, Thing

RATE, MOST_FRAMES = 25.0, 2000
"""Hz of the poses that are stored, between which a browser turns and moves straight on, and how many at most:
a point 1 m out at 3 rad/s is then within 2 mm of where it is."""
LINES, ASKED = 3, 8
"""Distances that are drawn at a time, and that are asked for: some are left out."""
STILL_M, ROOM_M = 0.003, 0.02
"""m by which a distance varies at most, and m that are left of it at least, to be left out: a shoulder turns
above its floor."""
SMALLEST = 0.1
"""Part of the motion's extent that a robot is drawn with at least, where nobody looks at its distances."""
SHOWN_M = 0.15
"""m beyond what is kept, from which on a distance is not drawn."""
SAME_M = 0.02
"""m within which a motion ends where it started."""
OPEN_ROWS = 6
"""Rows of the certificate that are seen at once, the narrowest first."""
RING = 48  # corners of a round room

TEXT = (
    "Solid is the robot along {title} as it was planned; the blue line is the way of {tips}. The pale skin "
    "holds all that the robot sweeps. {colour}"
)
COLOUR = (
    "Lines join what comes nearest, with the distance as planned. Their colour, and that of the parts, tells "
    "how much is left beyond what is kept. Neighbours, which always pass close, have none."
)
HULLS = "Drawn are the shapes that distances are taken of: convex hulls, not the finer meshes."
STICKS = "The description has no shapes, so bars stand for links."
ENLARGED = "It is drawn {times} times as large as it is."
NO_DISTANCES = "No distance is looked at for this robot: what it would hit is not known."
AROUND = "Around it is what the robot's file names: {names}."
NOTHING = "The robot's file names nothing that stands around it."
NEAREST = "Nearest as planned, but for neighbours: {pair}, {apart} at {time:.1f} s, where {kept} are kept."
PROVED = (
    "The certificate of this file, the narrowest first: what is kept, and what is proved at all times, "
    "tracking errors taken off."
)
CANNOT = "Name a model file in robot.toml (model_file): URDF or MJCF."
HINT = "Drag: turn. Shift and drag, or two fingers: move. Wheel: nearer. Double click: back."
NO_VIEW = "This browser has no WebGL 2, so the motion cannot be shown in space."


@dataclass(frozen=True, eq=False)
class MotionInSpace:
    """A motion to be shown.

    Attributes:
        title: of it. pieces: when each begins, s, and what it is.
        certificate: of the file that is shown; None if it cannot be read.
        t: (T,) s. motion: at these times.
        solids: B parts. placed: (T, B, 3, 4) of them.
        figure: as sticks, with what stands around.
        nearby: how near all come, at the same times; None where nobody looks.
    """

    title: str
    pieces: Sequence[tuple[float, str]]
    certificate: Facts | None
    t: Array
    motion: Motion
    solids: Sequence[Solid]
    placed: Array
    figure: Figure
    nearby: Nearby | None

    @property
    def tips(self) -> list[Array]:
        """(T, 3) m each."""
        return [self.figure.points[:, tip] for tip in self.figure.tips]

    @cached_property
    def silent(self) -> Mask:
        """(R,) rows of neighbours, which always pass closely, and of what stays as far as it is."""
        near = self.nearby
        assert near is not None
        still = (np.ptp(near.distance, axis=0) < STILL_M) & ((near.distance - near.kept).min(axis=0) > ROOM_M)
        return np.asarray(near.neighbours | still)

    @property
    def enlarged(self) -> int:
        """How many times as large as it is a robot is drawn that would be a dot on its way."""
        if self.nearby is not None or len(self.solids) != 1:
            return 1
        way = np.linalg.norm(np.ptp(self.placed[:, 0, :, 3], axis=0))
        return max(1, round(SMALLEST * float(way) / float(np.ptp(self.solids[0].points, axis=0).max())))

    @property
    def closest(self) -> tuple[int, int] | None:
        """When least room is left beyond what is kept, and in which row; neighbours do not count."""
        near = self.nearby
        if near is None or self.silent.all():
            return None
        spare = np.where(self.silent, np.inf, near.distance - near.kept)
        k, row = np.unravel_index(int(spare.argmin()), spare.shape)
        return int(k), int(row)

    @property
    def nearest(self) -> Facts | None:
        """That in figures: the pair, its distance and what is kept in m, the time in s."""
        if self.closest is None or self.nearby is None:
            return None
        (k, row), near = self.closest, self.nearby
        apart, kept = float(near.distance[k, row]), float(near.kept[row])
        return {"pair": list(near.pairs[row]), "distance": apart, "kept": kept, "time": float(self.t[k])}


def in_space(record: Record, proposal: int) -> MotionInSpace | None:
    """The motion of a proposal, with the way there and back if that was asked for; None without a drawing."""
    trajectory, certificate, way = record.whole(proposal)
    campaign = record.campaign
    if trajectory is None or campaign is None:
        return None
    count = int(min(MOST_FRAMES, max(2, np.ceil(trajectory.duration * RATE) + 1)))
    t = np.linspace(0.0, trajectory.duration, count)
    motion = trajectory.motion(t, 2)
    q, kind = motion.orders[0], campaign.kind
    solids: Sequence[Solid] = ()
    placed = np.zeros((count, 0, 3, 4))
    if isinstance(kind, SupportsSolids):
        solids = kind.solids(campaign.spec)
        placed = kind.placed(campaign.spec, motion) if solids else placed
    figure = figure_along(record, q)
    if figure is None and not solids:
        return None
    figure = figure or _of_point(record, t, placed[:, -1, :, 3])
    near = [limit.nearby(q, ASKED) for limit in record.limits if isinstance(limit, SupportsNearby)]
    pieces = [(start, label) for start, label, _ in trajectory.pieces()]
    title = f"trajectory {proposal}" + (f" with the way {way} and back" if way else "")
    return MotionInSpace(
        title, pieces, certificate, t, motion, solids, placed, figure, near[0] if near else None
    )


def _of_point(record: Record, t: Array, place: Array) -> Figure:
    """What moves in a room as a point (T, 3), with the room."""
    room = room_of(record.limits, [Path(t, place)])
    things = [replace(Thing.box("room", room.lower, room.upper), kind="inside"), *things_of(record.limits)]
    if room.radius is not None:
        turn = 2.0 * np.pi * np.arange(RING) / RING
        ring = room.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        points = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (room.lower[2], room.upper[2])])
        rings = tuple(range(RING)), tuple(range(RING, 2 * RING))
        things.append(Thing("cylinder", "inside", points[None], rings))
    things.append(Thing.plane("bottom of the room", [0.0, 0.0, room.lower[2]], [0.0, 0.0, 1.0]))
    return Figure(place[:, None], np.zeros((0, 2), dtype=np.int64), (0,), tuple(things))


def page(record: Record, proposal: int, stream: str = "") -> tuple[Html, MotionInSpace]:
    """The drawing with what is proved of it as a page of its own, and what it shows.

    Raises:
        UsageError: no such proposal, or a robot that cannot be drawn.
    """
    found = in_space(record, proposal)
    if found is None:
        raise UsageError(
            f"proposal {proposal} cannot be shown",
            where=str(record.folder),
            next_step=record.notes[-1] if record.notes else CANNOT,
        )
    title = f"{record.robot}: {found.title}"
    head = element("style", Html(asset("report.css") + asset("space.css")))
    parts = [element("h1", title), words(found), element("p", nearest_words(found), class_="lead")]
    parts += [figure_in_space(found, record, proved(found), stream)]
    main = Html(f"<main>\n{join(parts)}\n</main>")
    return document(title, head, main, element("script", Html(asset("space.js")))), found


def asset(name: str) -> str:
    """A file that pages are made of."""
    return resources.files("etude.report").joinpath(name).read_text(encoding="utf-8")


def figure_in_space(seen: MotionInSpace, record: Record, below: Html, stream: str = "") -> Html:
    """The drawing with all that belongs to it. below: what more is said, whose buttons of times act too.
    stream: the address of poses of the real robot.
    """
    parts = [
        element(
            "div",
            element(
                "canvas", class_="view", tabindex=0, role="img", **{"aria-label": f"{seen.title} in space"}
            ),
            element("div", class_="labels", **{"aria-hidden": "true"}),
            paragraph(HINT, class_="hint"),
            class_="stage-3d",
        ),
        element("p", NO_VIEW, class_="missing no-view", hidden="hidden"),
        element("div", *_controls(seen), class_="controls", hidden="hidden"),
        below,
        element("script", Html(_data(seen, record, stream)), type="application/json"),
    ]
    return element("figure", *parts, class_="space")


def words(seen: MotionInSpace) -> Html:
    """What one sees, in sentences."""
    tips = "its tip" if len(seen.figure.tips) == 1 else "its tips"
    names = [thing.name for thing in seen.figure.things if thing.kind in ("solid", "plane", "inside")]
    said = [
        TEXT.format(title=seen.title, tips=tips, colour=COLOUR if seen.nearby else ""),
        HULLS if seen.nearby else STICKS if not seen.solids else "",
        ENLARGED.format(times=seen.enlarged) if seen.enlarged > 1 else "",
        AROUND.format(names=", ".join(names)) if names else NOTHING,
    ]
    return paragraph(" ".join(filter(None, said)))


def nearest_words(seen: MotionInSpace) -> str:
    """A sentence on what comes nearest."""
    near = seen.nearest
    if near is None:
        return NO_DISTANCES
    apart, kept = (f"{number(1000.0 * near[key])} mm" for key in ("distance", "kept"))
    return NEAREST.format(pair=" and ".join(near["pair"]), apart=apart, time=near["time"], kept=kept)


def proved(seen: MotionInSpace) -> Html:
    """Distances that the certificate states, and what it leaves open."""
    if seen.certificate is None:
        return Html("")
    pairs = {" and ".join(pair) for pair in (seen.nearby.pairs if seen.nearby else ())}
    rows = sorted(
        (r for r in seen.certificate["rows"] if r["axis"] in pairs), key=lambda r: float(r["slack"])
    )
    cells = [_cells(row) for row in rows]
    header = ("Distance", "kept (mm)", "proved (mm)", "for tracking (mm)", "nearest")
    parts = [paragraph(PROVED), table(header, cells[:OPEN_ROWS])] if cells else []
    if cells[OPEN_ROWS:]:
        more = element("summary", f"{len(cells) - OPEN_ROWS} wider ones")
        parts.append(element("details", more, table(header, cells[OPEN_ROWS:])))
    for title, key in (("To be confirmed", "to_confirm"), ("Not verified", "not_verified")):
        items = [element("li", sentence) for sentence in seen.certificate.get(key) or ()]
        parts += [element("h3", title), element("ul", *items)] if items else []
    return join(parts)


WHERE = re.compile(r"(?:^| )at ([\d.e+-]+) s(?: of the .* at ([\d.e+-]+) s)?$")
"""How a certificate says when something happens: in a piece, and when that began."""


def _cells(row: Mapping[str, Any]) -> list[object]:
    numbers = [number(1000.0 * float(row[key])) for key in ("lower", "proved_lower", "tracking_margin")]
    where, found = str(row.get("where", "")), WHERE.search(str(row.get("where", "")))
    if found is None or " and " not in where:
        return [row["axis"], *numbers, ""]
    moment = sum(float(part) for part in found.groups() if part)
    button = element(
        "button", f"{moment:.1f} s", type="button", class_="at", **{"data-time": f"{moment:.4f}"}
    )
    return [row["axis"], *numbers, button]


def _controls(seen: MotionInSpace) -> list[Html]:
    """What one can set, and tables that the script fills."""
    speeds = [element("option", f"{s:g} times its speed", value=s) for s in (0.1, 0.25, 0.5)]
    speeds += [Html('<option value="1" selected>its own speed</option>')]
    speeds += [element("option", f"{s:g} times its speed", value=s) for s in (2, 4)]
    ends = f'min="0" max="{seen.t[-1]:.6g}" step="any" value="0"'
    slider = Html(f'<input type="range" name="time" {ends} aria-label="time">')
    strip = Html('<canvas class="strip" height="8" aria-hidden="true"></canvas>') if seen.nearby else Html("")
    ticked = [("swept", "what is swept"), ("path", "way of the tip")]
    ticked += [("distances", "distances")] if seen.nearby else []
    boxes = [Html(f'<label><input type="checkbox" name="{n}" checked> {w}</label>') for n, w in ticked]
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
            element("div", element("h3", "Nearest now"), *_scale(seen)),
            element(
                "div",
                element("h3", "Where it is now"),
                element("table", element("thead", joints), element("tbody"), class_="joints"),
            ),
            class_="beside",
        ),
    ]


def _scale(seen: MotionInSpace) -> list[Html]:
    if seen.nearby is None:
        return [paragraph(NO_DISTANCES, class_="missing")]
    return [
        element("ul", class_="nearest"),
        element("p", "beyond what is kept: 0", element("i"), "100 mm and more", class_="soft scale"),
    ]


def _data(seen: MotionInSpace, record: Record, stream: str) -> str:
    """What the script needs, as JSON in which nothing ends a script."""
    room = _room(seen)
    points = [*seen.tips, seen.figure.points, seen.placed[..., 3]]
    if seen.nearby is not None:
        points.append(np.nan_to_num(seen.nearby.ends))
    unit = max(float(np.abs(own).max(initial=0.0)) for own in points) / 32000.0 or 1e-4
    low, high = _extent(seen)
    turns = (
        Rotation.from_matrix(seen.placed[..., :3].reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]]
        if seen.solids
        else np.zeros((0, 4))
    )
    frames = np.concatenate([seen.placed[..., 3].reshape(-1, 3) / unit, 32767.0 * turns], axis=1)
    facts = {
        "unit": unit,
        "step": float(seen.t[1] - seen.t[0]),
        "count": len(seen.t),
        "size": float(np.linalg.norm(high - low)),
        "middle": (0.5 * (low + high)).tolist(),
        "bodies": [_body(seen, b) for b in range(len(seen.solids))],
        "frames": _packed(frames, np.int16),
        "sticks": [] if seen.solids else seen.figure.sticks.tolist(),
        "points": "" if seen.solids else _packed(seen.figure.points / unit, np.int16),
        "things": [_thing(thing, room) for thing in seen.figure.things if thing.kind != "carried"],
        "tips": [_packed(tip / unit, np.int16) for tip in seen.tips],
        "marks": _marks(seen),
        "pieces": [{"start": start, "label": label} for start, label in seen.pieces],
        "joints": _joints(record),
        "q": _packed(seen.motion.orders[0], np.float32),
        **_distances(seen, unit),
        "nothing": f"nothing within {1000.0 * SHOWN_M:.0f} mm of what is kept",
        "stream": stream,
    }
    return json.dumps(facts, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _packed(values: ArrayLike, kind: type[np.generic]) -> str:
    """Base64 of numbers as the script reads them: little-endian, whole ones rounded and held in range."""
    found = np.asarray(values, dtype=float).ravel()
    if issubclass(kind, np.integer):
        ends = np.iinfo(kind)
        found = np.clip(np.rint(np.nan_to_num(found)), ends.min, ends.max)
    return base64.b64encode(found.astype(np.dtype(kind).newbyteorder("<")).tobytes()).decode()


def _extent(seen: MotionInSpace) -> tuple[Array, Array]:
    """(3,) corners of a box around all that moves, m."""
    points = _corners(seen).reshape(-1, 3)
    return points.min(axis=0), points.max(axis=0)


def _corners(seen: MotionInSpace) -> Array:
    """(T, P, 3) m in the world: the sticks' points, or corners of boxes about the solid parts."""
    if not seen.solids:
        return seen.figure.points
    boxes = [
        np.array(np.meshgrid(*zip(s.points.min(axis=0), s.points.max(axis=0), strict=True)))
        for s in seen.solids
    ]
    own = np.stack([box.reshape(3, 8).T for box in boxes])
    turned = np.einsum("tbij,bpj->tbpi", seen.placed[..., :3], own) + seen.placed[..., None, :, 3]
    return np.asarray(turned.reshape(len(seen.t), -1, 3))


def _room(seen: MotionInSpace) -> SceneBox:
    return room_around(replace(seen.figure, points=_corners(seen)))


def _body(seen: MotionInSpace, b: int) -> dict[str, object]:
    """One part, its points in whole steps, and whether it moves at all."""
    solid, placed = seen.solids[b], seen.placed[:, b]
    unit = float(np.abs(solid.points).max()) / 32000.0
    facts = {
        "name": solid.name,
        "unit": unit * seen.enlarged,
        "moves": bool(np.ptp(placed, axis=0).max() > 1e-9),
    }
    return {
        **facts,
        "points": _packed(solid.points / unit, np.int16),
        "faces": _packed(solid.faces, np.uint16),
    }


def _thing(thing: Thing, room: SceneBox) -> dict[str, object]:
    """What stands around as far as it is near: faces, edges, and where its name stands."""
    faces = [face.round(4) for face in faces_in(thing, room)]
    points = np.concatenate(faces) if faces else np.zeros((0, 3))
    first = np.cumsum([0, *map(len, faces)])
    edges = [
        [a.tolist(), b.tolist()]
        for face in faces
        for a, b in zip(face, np.roll(face, -1, axis=0), strict=True)
    ]
    if thing.kind == "plane" and len(points) and np.ptp(points[:, 2]) < 1e-6:
        edges += _grid(points)
    numbered = [[*range(a, b)] for a, b in pairwise(first.tolist()) if b - a > 2]
    side = (
        EYE * [-1.0, -1.0, 1.0] if thing.kind == "inside" else EYE
    )  # a room is named where it hides nothing
    place = points[int((points @ side).argmax())].tolist() if len(points) else None
    if thing.kind == "solid" and len(points):
        place = [*points[:, :2].mean(axis=0).tolist(), float(points[:, 2].max())]
    return {
        "name": thing.name,
        "kind": thing.kind,
        "points": points.tolist(),
        "faces": numbered,
        "edges": edges,
        "label": place,
    }


def _grid(points: Array) -> list[list[list[float]]]:
    """Lines on a level floor at round metres."""
    (x0, y0, z), (x1, y1, _) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    step = linear_ticks(0.0, max(x1 - x0, y1 - y0), 8)[1]
    along, across = (
        (np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step).tolist()
        for low, high in ((x0, x1), (y0, y1))
    )
    return [[[x, y0, z], [x, y1, z]] for x in along] + [[[x0, y, z], [x1, y, z]] for y in across]


def _marks(seen: MotionInSpace) -> list[dict[str, object]]:
    """Where tips start and end, and where all come closest."""
    found = []
    for tip in seen.tips[:1]:
        same = float(np.linalg.norm(tip[0] - tip[-1])) < SAME_M
        found.append({"text": "start and end" if same else "start", "at": tip[0].tolist(), "time": 0.0})
        found += [] if same else [{"text": "end", "at": tip[-1].tolist(), "time": float(seen.t[-1])}]
    if seen.closest is not None and seen.nearby is not None:
        k, row = seen.closest
        at = np.flatnonzero(seen.nearby.narrowest[k] == row)
        place = seen.nearby.ends[k, at].mean(axis=(0, 1)) if len(at) else np.full(3, np.nan)
        if np.isfinite(place).all():
            words = f"closest: {1000.0 * seen.nearby.distance[k, row]:.0f} mm at {seen.t[k]:.1f} s"
            found.append({"text": words, "at": place.tolist(), "time": float(seen.t[k])})
    return found


def _joints(record: Record) -> list[dict[str, object]]:
    """Names, units and ranges of the coordinates of the path."""
    campaign, path = record.campaign, record.path
    assert campaign is not None
    assert path is not None
    known = campaign.kind.expected(campaign.spec).limits.get(path.name)
    lower, upper = (np.broadcast_to(side, len(path.parts)) for side in known or (np.nan, np.nan))
    return [
        {"name": name, "unit": unit, "lower": _finite(low), "upper": _finite(high)}
        for name, unit, low, high in zip(path.parts, path.units, lower, upper, strict=True)
    ]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _distances(seen: MotionInSpace, unit: float) -> dict[str, object]:
    """What is left of each part's distances, mm, and the narrowest with their ends."""
    near = seen.nearby
    if near is None:
        return {
            "rows": [],
            "lines_each": 0,
            "lines": "",
            "room": _packed(np.full((len(seen.t), len(seen.solids)), 65535), np.uint16),
        }
    spare, silent = near.distance - near.kept, seen.silent
    left = np.full((len(seen.t), len(seen.solids)), np.inf)
    for b, solid in enumerate(seen.solids):
        own = [r for r, pair in enumerate(near.pairs) if solid.name in pair and not silent[r]]
        left[:, b] = spare[:, own].min(axis=1, initial=np.inf)
    apart, rows = (np.take_along_axis(one, near.narrowest, axis=1) for one in (near.distance, spare))
    drawn = (rows < SHOWN_M) & np.isfinite(near.ends).all(axis=(2, 3)) & ~silent[near.narrowest]
    row = np.where(drawn, near.narrowest, -1)[..., None]
    lines = np.concatenate([row, 1e4 * apart[..., None], near.ends.reshape(*apart.shape, 6) / unit], axis=2)
    first = np.argsort(~drawn, axis=1, kind="stable")[:, :LINES, None]
    lines = np.take_along_axis(lines, first, axis=1)
    named = [
        {"pair": " and ".join(pair), "kept": 1000.0 * float(kept)}
        for pair, kept in zip(near.pairs, near.kept, strict=True)
    ]
    room = _packed(np.where(np.isfinite(left), 1000.0 * left, 65535.0), np.uint16)
    return {"rows": named, "lines_each": lines.shape[1], "lines": _packed(lines, np.int16), "room": room}
