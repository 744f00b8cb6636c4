"""Pairs of shapes whose distance is checked: within the robot, and with its surroundings.

MuJoCo's own filter serves contacts and is no basis for proofs: it ignores that a part welded to the world has
a parent. So pairs are chosen here. Omitted are shapes of one rigid part, of parts on both sides of one joint,
and pairs that the robot file ignores.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from types import MappingProxyType
from typing import Any

from etude.errors import UsageError
from etude.types import Array
from etude_arm.clearance.distances import CUTOFF, Gap, Gaps
from etude_arm.clearance.hull_reduction import Fewer, put
from etude_arm.clearance.skeleton import BOX, Skeleton, skeleton_of
from etude_arm.clearance.surroundings import Column, Surroundings, Wall
from etude_arm.loading.loaded_model import Loaded, refused

NONE: Mapping[str, Fewer] = MappingProxyType({})


def gaps_of(
    loaded: Loaded, lower: Array, upper: Array, around: Surroundings, hull_proxies: Mapping[str, Fewer] = NONE
) -> Gaps:
    """All checked distances.

    Args:
        loaded: the robot. lower, upper: (k,) limits of its joints, rad (m).
        around: the surroundings, and ignored pairs.
        hull_proxies: reduced hulls by the names of their shapes.

    Raises:
        UsageError: MuJoCo refuses the model, the model has other joints, or a name in `ignore` is unknown.
    """
    spec = _spec(loaded, around)
    put(spec, hull_proxies)
    enlargements = {name: one.radius for name, one in hull_proxies.items()}
    skeleton = skeleton_of(_compiled(spec, loaded), loaded.joints, lower, upper, enlargements)
    _check_names(skeleton, around)
    ignored = {frozenset(pair) for pair in around.collision.ignore}
    excluded = {frozenset(pair) for pair in loaded.excluded}
    sensed = [gap for gap in _self_pairs(skeleton, excluded) if not _is_ignored(gap, ignored)]
    boxes = [gap for gap in _boxed(skeleton) if not _is_ignored(gap, ignored)]
    walled = [(gap, planes) for gap, planes in _walled(skeleton, around) if not _is_ignored(gap, ignored)]
    for gap in (*sensed, *boxes):
        _add_sensor(spec, skeleton, gap)
    with_sensors = replace(skeleton, model=_compiled(spec, loaded))
    loaded.check(with_sensors.model)
    walls, planes = zip(*walled, strict=True) if walled else ((), ())
    return Gaps(with_sensors, (*sensed, *boxes), walls, planes)


def _spec(loaded: Loaded, around: Surroundings) -> Any:
    """The robot's `mujoco.MjSpec` with names for all geoms, without sensors and boxed shapes, and with the
    boxes.
    """
    import mujoco

    spec = loaded.spec()
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)  # sensors do not need them
    for i, geom in enumerate(spec.geoms):
        geom.name = geom.name or f"{geom.parent.name or 'base'}#{i}"
    _take_out(spec, around.collision.boxed)
    for box in around.box:
        turn = [math.cos(0.5 * box.turn), 0.0, 0.0, math.sin(0.5 * box.turn)]
        half = [0.5 * edge for edge in box.size]
        # contacts are none of its business: it takes part through sensors alone
        kind = mujoco.mjtGeom.mjGEOM_BOX
        spec.worldbody.add_geom(
            name=BOX + box.name, type=kind, size=half, pos=box.centre, quat=turn, contype=0, conaffinity=0
        )
    return spec


def _take_out(spec: Any, boxed: Sequence[str]) -> None:
    shapes = {geom.name: geom for geom in spec.geoms}
    lost = [name for name in boxed if name not in shapes]
    if lost:
        raise UsageError(
            f"the model file has no shape {', '.join(lost)}",
            where="collision.boxed",
            next_step="Remove boxes that no longer exist from it.",
        )
    for name in boxed:
        spec.delete(shapes[name])


def _compiled(spec: Any, loaded: Loaded) -> Any:
    try:
        return spec.compile()
    except ValueError as problem:
        raise refused(problem, loaded.source) from None


def excluded_links(skeleton: Skeleton, loaded: Loaded) -> tuple[tuple[str, str], ...]:
    """Links that a joint can bring together although an MJCF excludes their contact."""
    pairs = {frozenset(pair) for pair in loaded.excluded}
    shapes = [(skeleton.shapes[i], skeleton.shapes[k]) for i, k in _meeting(skeleton)]
    links = [(one.link, other.link) for one, other in shapes if frozenset((one.name, other.name)) in pairs]
    return tuple(dict.fromkeys(links))


def _self_pairs(skeleton: Skeleton, excluded: Collection[frozenset[str]]) -> list[Gap]:
    """Pairs of the robot's shapes that a joint can bring together."""
    gaps = []
    for i, k in _meeting(skeleton):
        one, other = skeleton.shapes[i], skeleton.shapes[k]
        if frozenset((one.name, other.name)) not in excluded:
            first, second = sorted((one.part, other.part))
            gaps.append(Gap(i, k, (one.link, other.link), (skeleton.parts[second], skeleton.parts[first])))
    return gaps


def _meeting(skeleton: Skeleton) -> Iterator[tuple[int, int]]:
    """Numbers of shapes, without boxes, of parts that are neither the same nor joined by one joint."""
    for (i, one), (k, other) in combinations(enumerate(skeleton.shapes), 2):
        a, b = one.part, other.part
        if a == b or skeleton.parent[a] == b or skeleton.parent[b] == a:
            continue
        if not (one.box or other.box):
            yield i, k


def _boxed(skeleton: Skeleton) -> list[Gap]:
    boxes = [(k, shape.link) for k, shape in enumerate(skeleton.shapes) if shape.box]
    return [_with_thing(skeleton, i, k, name) for i in _moving(skeleton) for k, name in boxes]


def _walled(skeleton: Skeleton, around: Surroundings) -> list[tuple[Gap, tuple[Wall, ...] | Column]]:
    things: dict[str, tuple[Wall, ...] | Column] = {}
    for wall in around.walls:
        before = things.get(wall.name, ())
        things[wall.name] = (*before, wall) if isinstance(before, tuple) else before
    if around.column is not None:
        things["column"] = around.column
    return [
        (_with_thing(skeleton, i, -1, name), planes)
        for i in _moving(skeleton)
        for name, planes in things.items()
    ]


def _moving(skeleton: Skeleton) -> list[int]:
    """Numbers of the shapes that a joint moves."""
    return [i for i, shape in enumerate(skeleton.shapes) if shape.part]


def _with_thing(skeleton: Skeleton, i: int, other: int, name: str) -> Gap:
    shape, name = skeleton.shapes[i], skeleton.called(name)
    return Gap(i, other, (shape.link, name), (skeleton.parts[shape.part], name))


def _add_sensor(spec: Any, skeleton: Skeleton, gap: Gap) -> None:
    import mujoco

    ends = [skeleton.shapes[i] for i in (gap.one, gap.other)]
    cutoff = CUTOFF + sum(end.thickness for end in ends)
    geom, kind = mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtSensor.mjSENS_GEOMDIST
    names = {"objname": ends[0].name, "refname": ends[1].name}
    spec.add_sensor(type=kind, objtype=geom, reftype=geom, cutoff=cutoff, **names)


def _is_ignored(gap: Gap, ignored: set[frozenset[str]]) -> bool:
    return frozenset(gap.names) in ignored or frozenset(gap.row) in ignored


def _check_names(skeleton: Skeleton, around: Surroundings) -> None:
    things = [box.name for box in around.box] + [wall.name for wall in around.walls]
    things += ["floor", "room", "column"]
    links = {shape.link for shape in skeleton.shapes if not shape.box}
    names = links | set(skeleton.parts) | set(map(skeleton.called, things))
    unknown = sorted({name for pair in around.collision.ignore for name in pair} - names)
    if unknown:
        raise UsageError(
            f"no link or obstacle is called {', '.join(unknown)}",
            where="collision.ignore",
            next_step=f"Links with shapes, and obstacles: {', '.join(sorted(names))}.",
        )
