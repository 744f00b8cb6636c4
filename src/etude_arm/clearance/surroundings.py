"""Surroundings of a robot, and the distances it keeps from them: tables of the robot file.

[collision]
margin = 0.01               # m, kept beyond what tracking needs
ignore = [["link1", "link3"]]   # links whose distance is nobody's business
boxed = ["table#0"]         # shapes of the model file that do not count: boxes of this file stand for them
look = true                 # false: no distance is looked at
[floor]
height = 0.0                # m, in the room that the base is mounted in; the robot stays above
[[box]]                     # something to stay out of
name = "table"
centre = [0.6, 0.0, 0.2]    # m
size = [0.4, 0.8, 0.4]      # m, whole edges
turn = 0.0                  # rad about the vertical
[[wall]]                    # a plane; the robot stays on the side that `normal` points to
name = "fence"
point = [1.2, 0.0, 0.0]
normal = [-1.0, 0.0, 0.0]
[room]                      # the robot stays inside
lower = [-1.0, -1.0, 0.0]
upper = [1.0, 1.0, 2.0]
[column]                    # the robot stays within this distance of the vertical through `centre`
radius = 1.2
centre = [0.0, 0.0]
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from etude.errors import UsageError

MARGIN = 0.01
"""Distance, m, of parts from each other and from the surroundings, beyond the tracking margin."""
ADD_FLOOR = ": add [floor] with its height."
"""Ends what is to be confirmed of a robot without a floor, until its file has one."""
SHORTEST = 1e-9
"""Length of a normal that is none."""

Point = tuple[float, float, float]


def _check(fits: bool, fact: str) -> None:
    if not fits:
        raise UsageError(fact, next_step="Correct it in the robot file.")


def _check_finite(what: str, *numbers: float) -> None:
    stated = ", ".join(f"{number:g}" for number in numbers)
    several = "finite numbers" if len(numbers) > 1 else "a finite number"
    _check(all(map(math.isfinite, numbers)), f"{what} needs {several}, not {stated}")


@dataclass(frozen=True)
class Collision:
    """Distances to keep, and pairs of links without one.

    Attributes:
        margin: m, beyond the effect of tracking; half of a pair's distance at home if that is less.
        ignore: pairs of links, as in the model file, whose distance is not verified.
        boxed: shapes of the model file, "link#k", that boxes of the robot file replace.
        look: False: no distance is verified.
    """

    margin: float = MARGIN
    ignore: tuple[tuple[str, str], ...] = ()
    boxed: tuple[str, ...] = ()
    look: bool = True

    def __post_init__(self) -> None:
        _check_finite("margin", self.margin)
        _check(self.margin > 0.0, f"margin must be above 0 m, not {self.margin:g}")


@dataclass(frozen=True)
class Floor:
    """A horizontal plane at `height` m in the room; the robot stays above."""

    height: float

    def __post_init__(self) -> None:
        _check_finite("height", self.height)


@dataclass(frozen=True)
class Box:
    """A box to stay out of: centre and whole edges in m, turned by `turn` rad about the vertical."""

    name: str
    centre: Point
    size: Point
    turn: float = 0.0

    def __post_init__(self) -> None:
        for what, numbers in {"centre": self.centre, "size": self.size, "turn": (self.turn,)}.items():
            _check_finite(f"{what} of box '{self.name}'", *numbers)
        _check(min(self.size) > 0.0, f"box '{self.name}' needs edges above 0 m, not {min(self.size):g}")


@dataclass(frozen=True)
class Wall:
    """A plane through `point` (m); the robot stays on the side that `normal` points to."""

    name: str
    point: Point
    normal: Point

    def __post_init__(self) -> None:
        _check_finite(f"point of wall '{self.name}'", *self.point)
        _check_finite(f"normal of wall '{self.name}'", *self.normal)
        _check(math.hypot(*self.normal) > SHORTEST, f"wall '{self.name}' needs a normal that is not zero")


@dataclass(frozen=True)
class Room:
    """A box, m, that the robot stays inside."""

    lower: Point
    upper: Point

    def __post_init__(self) -> None:
        fits = all(a < b for a, b in zip(self.lower, self.upper, strict=True))
        _check(fits, f"room needs lower below upper, not {self.lower} and {self.upper}")


@dataclass(frozen=True)
class Column:
    """An upright cylinder, m, that the robot stays inside."""

    radius: float
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        _check_finite("centre of column", *self.centre)
        _check_finite("radius of column", self.radius)
        _check(self.radius > 0.0, f"column needs a radius above 0 m, not {self.radius:g}")


@dataclass(frozen=True)
class Search:
    """Where the search looks for motions: a clear pose and a box about it. No proof depends on it.

    Attributes:
        home: a clear pose, rad (m).
        lower, upper: ends of the box; later steps may enlarge motions beyond it.
    """

    home: tuple[float, ...]
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()


@dataclass(frozen=True)
class Surroundings:
    """All tables of the surroundings; without a table there is no such object."""

    collision: Collision = field(default_factory=Collision)
    floor: Floor | None = None
    box: tuple[Box, ...] = ()
    wall: tuple[Wall, ...] = ()
    room: Room | None = None
    column: Column | None = None
    search: Search | None = None

    def __post_init__(self) -> None:
        names = [box.name for box in self.box] + [wall.name for wall in self.wall]
        twice = sorted({name for name in names if names.count(name) > 1})
        _check(not twice, f"boxes and walls share the names {', '.join(twice)}")

    @property
    def walls(self) -> tuple[Wall, ...]:
        """Every plane: the floor, the walls, and the six sides of the room, which share one name."""
        walls = [] if self.floor is None else [Wall("floor", (0.0, 0.0, self.floor.height), (0.0, 0.0, 1.0))]
        walls += self.wall
        if self.room is not None:
            for axis in range(3):
                inward = tuple(1.0 if i == axis else 0.0 for i in range(3))
                outward = tuple(-1.0 if i == axis else 0.0 for i in range(3))
                walls += [Wall("room", self.room.lower, inward), Wall("room", self.room.upper, outward)]  # type: ignore[arg-type]
        return tuple(walls)
