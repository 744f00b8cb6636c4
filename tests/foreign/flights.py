"""Flights for vehicles that nobody tuned, and what PX4's cascade makes of the bytes that leave for it."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from px4_cascade import Body, fly, padded

from etude import ask, tell
from etude.campaign import Campaign, create_campaign, open_campaign, there_and_back
from etude.deploy import certify_played
from etude.limits import (
    Certificate,
    FeasibleSet,
    Ranges,
    TrackingConfig,
    at_rest,
    boundary,
    certify,
    margins_of,
    scaled,
    uniform,
)
from etude.protocols import Trajectory
from etude.trajectories import from_json
from etude_quadrotor import KIND, NED, OFFBOARD, FlightConfig, QuadrotorSpec, flight_family

Array = NDArray[np.float64]
BEFORE, AFTER, RATE = 10.0, 10.0, 50.0
SAMPLERS = (uniform, scaled, boundary)
QUICK = {"candidates = 100": "candidates = 20", "steps = 60": "steps = 15", "starts = 3": "starts = 1"}
"""Settings of a campaign whose designs take seconds."""


def vehicle(seed: int) -> QuadrotorSpec:
    """A real vehicle (no stand-in) in a room of its own: wide or small, with a cylinder or a tilt limit."""
    rng = np.random.default_rng([29, seed])
    half, height = rng.uniform(2.0, 12.0, size=2), rng.uniform(2.5, 8.0)
    return QuadrotorSpec(
        name=f"foreign_{seed}",
        lower=(-float(half[0]), -float(half[1]), 0.0),
        upper=(float(half[0]), float(half[1]), float(height)),
        speed=float(rng.uniform(1.0, 7.0)),
        command_names=("a", "b", "c", "d"),
        command_unit="1",
        command_lower=(0.0,) * 4,
        command_upper=(1.0,) * 4,
        rate=25.0,
        radius=float(0.8 * half.min()) if seed % 3 == 0 else None,
        tilt=float(rng.uniform(0.25, 0.6)) if seed % 2 == 0 else None,
        margin=1.0 if half.min() > 4.0 else 0.6,
        vertical_margin=0.3,
    )


@dataclass(frozen=True, eq=False)
class Planned:
    """A motion as it leaves, and what was promised of it: margin (3,) m about each place of the flight."""

    spec: QuadrotorSpec
    whole: Trajectory
    margin: Array
    files: dict[str, bytes]
    ground: bool

    @cached_property
    def rows(self) -> Array:
        """(n, 9) of the set-points."""
        return rows_of(self.files["setpoints.csv"])


def planned(spec: QuadrotorSpec, seed: int, *, ground: bool, exporter: Any = OFFBOARD) -> Planned:
    """A random flight as large as the limits less what is assumed of tracking, from rest to rest."""
    config = FlightConfig(2 + seed % 2, (15.0, 20.0, 12.0)[seed % 3], tilt=0.4363)
    ranges = Ranges.of((np.array(spec.lower), np.array(spec.upper)), _speeds(spec), KIND.home(spec))
    margins = margins_of(TrackingConfig(), ranges, {}, ("fourier", "splined"))
    allowed, family = (
        KIND.limits(spec, SimpleNamespace(trajectory=config), None, margins),
        flight_family(config),
    )
    room = FeasibleSet.of(allowed, family, KIND.home(spec))
    drawn = family.trajectory(SAMPLERS[seed % 3](np.random.default_rng(seed), room)[0])
    whole: Trajectory = at_rest(drawn, allowed)
    if ground:
        way = there_and_back(
            whole,
            KIND.poses(spec)["ground"],
            lambda m, p: KIND.approaches(spec, m, p),
            allowed,
            KIND.home(spec),
        )
        assert way is not None
        assert way.whole is not None
        whole = way.whole
    certificate = certify(whole, allowed)
    assert certificate.ok
    assert certificate.at_rest
    files = exporter(whole, KIND, spec)
    held = certify_played(exporter, files, allowed, whole)
    assert {row.axis for row in held.rows} >= {"held before the first row", "held after the last row"}
    flight = next(piece for _, label, piece in whole.pieces() if label == "segment")
    return Planned(spec, whole, kept(certify(flight, allowed)), dict(files), ground)


def asked(robot: Path, folder: Path, seed: int, *, start: str, log: Path | None = None) -> Planned:
    """What `etude ask` proposes for a vehicle, for PX4; first, or after a log of a motion of another's."""
    path = create_campaign(folder, str(robot), seed=seed)[0].path
    config = path / "campaign.toml"
    text = config.read_text(encoding="utf-8")
    for old, new in QUICK.items():
        assert old in text
        text = text.replace(old, new)
    config.write_text(text, encoding="utf-8")
    campaign = open_campaign(path)
    if log is not None:
        tell(campaign, log, foreign=True)
    return proposed(campaign, start)


def proposed(campaign: Campaign, start: str) -> Planned:
    """The next proposal of a campaign, as its files say it."""
    found = ask(campaign, formats=["px4"], start=start, go_on=True)
    (place,) = {file.parent for own in found.exported for file in own.files}
    files = {file.name: file.read_bytes() for file in place.iterdir() if file.is_file()}
    written = place.parent if start else found.folder
    whole = from_json((written / "trajectory.json").read_bytes())
    return Planned(campaign.spec, whole, kept(found.certificate), files, start == "ground")


def robot_file(spec: QuadrotorSpec, path: Path) -> Path:
    """A robot.toml of it, as a user writes one."""
    words = {
        "kind": "quadrotor",
        "name": spec.name,
        "commands": list(spec.command_names),
        "command_unit": spec.command_unit,
        **{
            key: getattr(spec, key)
            for key in ("command_lower", "command_upper", "rate", "lower", "upper", "speed", "radius", "tilt")
        },
        "margin": spec.margin,
        "vertical_margin": spec.vertical_margin,
    }
    told = {key: list(value) if isinstance(value, tuple) else value for key, value in words.items()}
    lines = [f"{key} = {json.dumps(value)}" for key, value in told.items() if value is not None]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _speeds(spec: QuadrotorSpec) -> tuple[Array, Array]:
    return np.full(3, -spec.speed), np.full(3, spec.speed)


def rows_of(data: bytes) -> Array:
    """(n, 9) position, velocity, acceleration of setpoints.csv; north, east, down."""
    _, *rows = csv.reader(io.StringIO(data.decode()))
    return np.array(rows, dtype=float)[:, 1:10]


def left(flights: list[Planned], body: Body | None = None) -> list[str]:
    """A sentence for each flight that leaves a limit, or the plan by more than the margin, in the cascade:
    from ten seconds before its first row to ten seconds after its last.
    """
    table = padded([own.rows for own in flights], RATE, BEFORE, AFTER)
    ground = np.array([-own.spec.floor if own.ground else np.nan for own in flights])
    flown = fly(table, RATE, ground=ground, body=body)
    found = []
    for i, own in enumerate(flights):
        place, plan = (part[:, i] @ NED.T for part in (flown.position, flown.setpoint))
        found += [
            f"{own.spec.name}: {text}"
            for text in wrong(own, flown.t - BEFORE, place, plan, flown.velocity[:, i])
        ]
    return found


def wrong(own: Planned, t: Array, place: Array, plan: Array, velocity: Array) -> list[str]:
    """Sentences about t (T,) s from the first row; place and plan (T, 3) in Étude's frame; m/s (T, 3)."""
    spec, found = own.spec, []
    low, high = np.array(spec.lower), np.array(spec.upper)
    beyond = np.maximum(low - place, place - high).max()
    found += [f"{beyond:.3f} m out of the room"] if beyond > 1e-3 else []
    speed = float(np.linalg.norm(velocity, axis=1).max())
    found += [f"{speed:.3f} m/s of {spec.speed:.3f}"] if speed > spec.speed else []
    if spec.radius is not None:
        out = np.hypot(place[:, 0], place[:, 1]).max() - spec.radius
        found += [f"{out:.3f} m out of the cylinder"] if out > 0.0 else []
    off = np.abs(place - plan)
    # straight up or down no margin is kept: below the column's top there is nothing but the column
    off[column(own, t), 2] = 0.0
    over = off.max(axis=0) - own.margin
    found += [f"{over.max():.3f} m beyond the margin"] if over.max() > 0.0 else []
    end = float(np.linalg.norm(place[-1] - plan[-1]))
    found += [f"{end:.3f} m off after ten seconds"] if end > 0.1 else []
    return found


def kept(certificate: Certificate) -> Array:
    """(3,) m, the margins of the places in the certificate of a flight itself."""
    rows = {row.axis: row.tracking_margin for row in certificate.rows if row.quantity == "position"}
    return np.array([rows[axis] for axis in "xyz"])


def column(own: Planned, t: Array) -> Any:
    """(T,) while it takes off or lands, or stands."""
    pieces = own.whole.pieces()
    if not own.ground:
        return np.zeros(len(t), dtype=bool)
    up = next(start for start, label, _ in pieces if label != "take-off")
    down = next(start for start, label, _ in pieces if label == "landing")
    return (t < up) | (t > down)
