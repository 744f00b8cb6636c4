"""Data of the motion in space for the page's script: one JSON, numbers in base64, lengths in whole steps."""

from __future__ import annotations

import base64
import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from etude.report.motion_in_space import LINES, MotionInSpace
from etude.report.record import Record
from etude.report.scales import linear_ticks
from etude.report.scene import EYE, SceneBox, faces_in, room_around
from etude.types import Array, Thing

SHOWN_M = 0.15
"""m beyond what is kept, from which on a distance is not drawn."""
SAME_M = 0.02
"""m within which a motion ends where it started."""


def script_data(motion: MotionInSpace, record: Record, stream: str) -> str:
    """The script's data, as JSON without an end tag of a script."""
    room = _room(motion)
    real = motion.measured
    points = [*motion.tips, motion.figure.points, motion.placed[..., 3]]
    points += [np.nan_to_num(motion.nearby.ends)] if motion.nearby is not None else []
    points += [real.points, real.placed[..., 3]] if real is not None else []
    unit = max(float(np.abs(array).max(initial=0.0)) for array in points) / 32000.0 or 1e-4
    low, high = _extent(motion)
    facts = {
        "unit": unit,
        "step": float(motion.t[1] - motion.t[0]),
        "count": len(motion.t),
        "size": float(np.linalg.norm(high - low)),
        "middle": (0.5 * (low + high)).tolist(),
        "bodies": [_body(motion, b) for b in range(len(motion.solids))],
        "sticks": [] if motion.solids else motion.figure.sticks.tolist(),
        "planned": _poses(motion.motion.orders[0], motion.placed, motion.figure.points, unit),
        "measured": real and _poses(real.q, real.placed, real.points, unit, real.ends),
        "things": [_thing(thing, room) for thing in motion.figure.things if thing.kind != "carried"],
        "tips": [_packed(tip / unit, np.int16) for tip in motion.tips],
        "marks": _marks(motion),
        "pieces": [{"start": start, "label": label} for start, label in motion.pieces],
        "joints": _joints(record),
        **_distances(motion, unit),
        "nothing": f"nothing within {1000.0 * SHOWN_M:.0f} mm of the least distance allowed",
        "elsewhere": "shown along the whole motion at full speed",
        "stream": stream,
    }
    return json.dumps(facts, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _poses(
    q: Array, placed: Array, points: Array, unit: float, ends: tuple[float, float] = (0.0, math.inf)
) -> dict[str, object]:
    """Positions (T, k), and frames (T, B, 3, 4) as places in `unit` m and quaternions (w x y z).

    Without parts, the points (T, P, 3) m of sticks replace the frames. `ends`: interval in which they are
    known, s.
    """
    turns = np.zeros((0, 4))
    if placed.size:
        turns = Rotation.from_matrix(placed[..., :3].reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]]
        points = points[:, :0]
    frames = np.concatenate([placed[..., 3].reshape(-1, 3) / unit, 32767.0 * turns], axis=1)
    return {
        "q": _packed(q, np.float32),
        "frames": _packed(frames, np.int16),
        "points": _packed(points / unit, np.int16),
        "from": ends[0],
        "to": _finite(ends[1]),
    }


def _packed(values: ArrayLike, kind: type[np.generic]) -> str:
    """Base64 of numbers in the script's format: little-endian; integers are rounded and clipped."""
    numbers = np.asarray(values, dtype=float).ravel()
    if issubclass(kind, np.integer):
        ends = np.iinfo(kind)
        numbers = np.clip(np.rint(np.nan_to_num(numbers)), ends.min, ends.max)
    return base64.b64encode(numbers.astype(np.dtype(kind).newbyteorder("<")).tobytes()).decode()


def _extent(motion: MotionInSpace) -> tuple[Array, Array]:
    """Corners (3,) of a box around everything that moves, m."""
    points = _corners(motion).reshape(-1, 3)
    return points.min(axis=0), points.max(axis=0)


def _corners(motion: MotionInSpace) -> Array:
    """Points (T, P, 3) m in the world: of the sticks, or corners of boxes about the solid parts."""
    if not motion.solids:
        return motion.figure.points
    boxes = [
        np.array(np.meshgrid(*zip(s.points.min(axis=0), s.points.max(axis=0), strict=True)))
        for s in motion.solids
    ]
    corners = np.stack([box.reshape(3, 8).T for box in boxes])
    turned = np.einsum("tbij,bpj->tbpi", motion.placed[..., :3], corners) + motion.placed[..., None, :, 3]
    return np.asarray(turned.reshape(len(motion.t), -1, 3))


def _room(motion: MotionInSpace) -> SceneBox:
    return room_around(replace(motion.figure, points=_corners(motion)))


def _body(motion: MotionInSpace, b: int) -> dict[str, object]:
    """One part with its points in whole steps, and whether it moves."""
    solid, placed = motion.solids[b], motion.placed[:, b]
    unit = float(np.abs(solid.points).max()) / 32000.0
    facts = {
        "name": solid.name,
        "unit": unit * motion.enlarged,
        "moves": bool(np.ptp(placed, axis=0).max() > 1e-9),
    }
    return {
        **facts,
        "points": _packed(solid.points / unit, np.int16),
        "faces": _packed(solid.faces, np.uint16),
    }


def _thing(thing: Thing, room: SceneBox) -> dict[str, object]:
    """An object near the robot: faces, edges, and the place of its name."""
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
    """Lines at round metres on a level floor."""
    (x0, y0, z), (x1, y1, _) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    step = linear_ticks(0.0, max(x1 - x0, y1 - y0), 8)[1]
    along, across = (
        (np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step).tolist()
        for low, high in ((x0, x1), (y0, y1))
    )
    return [[[x, y0, z], [x, y1, z]] for x in along] + [[[x0, y, z], [x1, y, z]] for y in across]


def _marks(motion: MotionInSpace) -> list[dict[str, object]]:
    """Start and end of the tips, and the place of the least distance."""
    marks = []
    for tip in motion.tips[:1]:
        same = float(np.linalg.norm(tip[0] - tip[-1])) < SAME_M
        marks.append({"text": "start and end" if same else "start", "at": tip[0].tolist(), "time": 0.0})
        marks += [] if same else [{"text": "end", "at": tip[-1].tolist(), "time": float(motion.t[-1])}]
    if motion.closest is not None and motion.nearby is not None:
        k, row = motion.closest
        at = np.flatnonzero(motion.nearby.narrowest[k] == row)
        place = motion.nearby.ends[k, at].mean(axis=(0, 1)) if len(at) else np.full(3, np.nan)
        if np.isfinite(place).all():
            label = f"closest: {1000.0 * motion.nearby.distance[k, row]:.0f} mm at {motion.t[k]:.1f} s"
            marks.append({"text": label, "at": place.tolist(), "time": float(motion.t[k])})
    return marks


def _joints(record: Record) -> list[dict[str, object]]:
    """Names, units and ranges of the path's coordinates."""
    campaign, path = record.campaign, record.path
    assert campaign is not None
    assert path is not None
    limits = campaign.kind.expected(campaign.spec).limits.get(path.name)
    lower, upper = (np.broadcast_to(side, len(path.parts)) for side in limits or (np.nan, np.nan))
    return [
        {"name": name, "unit": unit, "lower": _finite(low), "upper": _finite(high)}
        for name, unit, low, high in zip(path.parts, path.units, lower, upper, strict=True)
    ]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _distances(motion: MotionInSpace, unit: float) -> dict[str, object]:
    """Distance of each part beyond its margin, mm, and the least one with its ends."""
    near = motion.nearby
    if near is None:
        return {
            "rows": [],
            "lines_each": 0,
            "lines": "",
            "room": _packed(np.full((len(motion.t), len(motion.solids)), 65535), np.uint16),
        }
    slack, silent = near.distance - near.kept, motion.silent
    left = np.full((len(motion.t), len(motion.solids)), np.inf)
    for b, solid in enumerate(motion.solids):
        members = [r for r, pair in enumerate(near.pairs) if solid.name in pair and not silent[r]]
        left[:, b] = slack[:, members].min(axis=1, initial=np.inf)
    apart, rows = (np.take_along_axis(one, near.narrowest, axis=1) for one in (near.distance, slack))
    drawn = (rows < SHOWN_M) & np.isfinite(near.ends).all(axis=(2, 3)) & ~silent[near.narrowest]
    row = np.where(drawn, near.narrowest, -1)[..., None]
    lines = np.concatenate([row, 1e4 * apart[..., None], near.ends.reshape(*apart.shape, 6) / unit], axis=2)
    first = np.argsort(~drawn, axis=1, kind="stable")[:, :LINES, None]
    lines = np.take_along_axis(lines, first, axis=1)
    named = [
        {"pair": " and ".join(pair), "kept": 1000.0 * float(margin)}
        for pair, margin in zip(near.pairs, near.kept, strict=True)
    ]
    room = _packed(np.where(np.isfinite(left), 1000.0 * left, 65535.0), np.uint16)
    return {"rows": named, "lines_each": lines.shape[1], "lines": _packed(lines, np.int16), "room": room}
