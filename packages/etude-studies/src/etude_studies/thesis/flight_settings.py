"""FlightSettings: everything that makes one run of chapter 5 differ from another; and what flies in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

from etude.campaign import CampaignConfig
from etude.design import DesignConfig
from etude.types import Log, Samples
from etude_studies.flight_world import THESIS_ROOM, Flights

PELICAN_ROOM = {"margin": 0.0, "vertical_margin": 0.3}
"""The whole cylinder for the plan (thesis 5.3), less what the ground needs; its file keeps more."""
ROOMS: Mapping[str, Mapping[str, Any]] = {"quadrotor": THESIS_ROOM, "pelican": PELICAN_ROOM}
DIFFERENCED = {"pelican": ("angular_acceleration",)}
"""Channels of the simulated log that the real one lacks: found from the gyroscope by differences (5.3)."""
NOISE = "mid"


@dataclass(frozen=True)
class Place:
    """What flies, and which flights it may fly: arms that share it share their tests.

    Attributes:
        vehicle: a built-in one. preset: of its kind. speed: largest, m/s; None: its file's.
        harmonics: N of the flights.
    """

    vehicle: str
    preset: str
    speed: float | None
    harmonics: int

    def samples(self, *logs: Log) -> Samples:
        """Samples of flights, each a group of its own."""
        missing = DIFFERENCED.get(self.vehicle, ())
        return flights_of(self).world.samples(*(log.without(*missing) for log in logs))


@lru_cache(maxsize=8)
def flights_of(place: Place) -> Flights:
    """The vehicle in its room."""
    room = {**ROOMS[place.vehicle], **({} if place.speed is None else {"speed": place.speed})}
    return Flights.of(place.vehicle, NOISE, place.preset, room, harmonics=place.harmonics)


@dataclass(frozen=True)
class Learning:
    """How a model is made of the first flight, whatever is flown afterwards.

    Attributes:
        place: where. noise_floor: in place of the preset's. acceleration: the same, "kinematic" or
            "specific_force". from_ground: whether the first flight takes off and lands.
    """

    place: Place
    noise_floor: float | None = None
    acceleration: str | None = None
    from_ground: bool = False

    @property
    def config(self) -> CampaignConfig:
        """The preset with these."""
        config = flights_of(self.place).world.config
        if self.noise_floor is not None:
            config = replace(config, model=replace(config.model, noise_floor=self.noise_floor))
        if self.acceleration is not None:
            config = replace(config, data=replace(config.data, acceleration=self.acceleration))
        return config


@dataclass(frozen=True)
class FlightSettings:
    """One arm of chapter 5; its seed apart.

    Attributes:
        vehicle: "quadrotor" (5.2) or "pelican" (5.3). preset: "literal" or "pelican".
        arm: random flights "uniform" on the allowed ones, "scaled" (of random size) or on their "boundary";
            "designed" ones of largest mean variance, from several starts or from one.
        flights: in all, the first one common to all arms.
        speed: largest, m/s; None: the vehicle's. harmonics: N.
        noise_floor: of the processes, in deviations of the command; None: the preset's.
        acceleration: an input, "kinematic" or "specific_force"; None: the preset's.
        candidates: random starts of a design. refine: how many of them are refined. steps: of each.
        points: planned samples of a design.
        tests: numbers of uniform, boundary and extreme test flights.
        from_ground: whether the first flight is learned from take-off to landing.
    """

    vehicle: str = "quadrotor"
    preset: str = "literal"
    arm: str = "uniform"
    flights: int = 10
    speed: float | None = None
    harmonics: int = 2
    noise_floor: float | None = None
    acceleration: str | None = None
    candidates: int = 8
    refine: int = 8
    steps: int = 30
    points: int = 75
    tests: tuple[int, int, int] = (20, 12, 10)
    from_ground: bool = False

    def __post_init__(self) -> None:
        uniform, boundary, extreme = self.tests  # a list, if it comes from JSON
        object.__setattr__(self, "tests", (uniform, boundary, extreme))

    @property
    def place(self) -> Place:
        return Place(self.vehicle, self.preset, self.speed, self.harmonics)

    @property
    def learning(self) -> Learning:
        return Learning(self.place, self.noise_floor, self.acceleration, self.from_ground)

    @property
    def recorded(self) -> dict[str, Any]:
        """The settings; without what was added after runs had been made, where it changes nothing."""
        settings = asdict(self)
        return (
            settings
            if self.from_ground
            else {name: settings[name] for name in settings if name != "from_ground"}
        )

    @property
    def design(self) -> DesignConfig:
        """Of the designed arms."""
        one = self.arm == "designed_one_start"
        candidates, refine = (1, 1) if one else (self.candidates, self.refine)
        config = flights_of(self.place).world.config.design
        return replace(config, candidates=candidates, refine=refine, steps=self.steps, points=self.points)
