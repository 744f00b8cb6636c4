"""Effect of tracking margins by control on a campaign of flights, and of a first flight at half speed.

The first flight is flown under feedback alone, later ones lean against the drag that was learned, as `etude
simulate` does. "one list": all logs count as one control's, as they did before margins were kept for each;
"by control": as they are; "slow first": the same, with the first flight at half of its speed.

    python -m etude_studies.flight_margins FILE [FIRST_SEED SEEDS [FLIGHTS]]

goes on where FILE ends, one line of JSON for each campaign, and prints the tables.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import etude
from etude.campaign import (
    CERTAIN,
    FEEDBACK,
    LEARNED,
    RUN_STREAM,
    TEST_STREAM,
    Campaign,
    create_campaign,
    newest_model,
    test_motions,
)
from etude.logs import write_log
from etude.protocols import Controller, Robot, Trajectory
from etude.trajectories import from_json
from etude.types import Array, Log
from etude_studies.paired import paired

ROBOTS = ("quadrotor_rough", "quadrotor")
MANNERS = ("one list", "by control", "slow first")
FLIGHTS = 4
FIRST, SEEDS = 4000, 16
HALF, FULL = 50, 100
"""%, of the speed."""
INSTANTS = 1501

Facts = Mapping[str, Any]


@dataclass(frozen=True)
class Case:
    """One campaign."""

    robot: str
    manner: str
    seed: int


def campaign_of(case: Case, flights: int = FLIGHTS) -> list[dict[str, Any]]:
    """What became of each flight, and of the tests after it."""
    with TemporaryDirectory() as folder:
        campaign, _ = create_campaign(Path(folder) / "campaign", case.robot, seed=case.seed)
        robot = campaign.kind.robot(campaign.spec, campaign.config)
        assert robot is not None
        return [_flown(campaign, robot, case.manner) for _ in range(flights)]


def _flown(campaign: Campaign, robot: Robot, manner: str) -> dict[str, Any]:
    """Asks for a flight, flies and tells it, and tests what was learned."""
    seed, beside = campaign.state().seed, _beside(campaign)
    control = FEEDBACK if beside is None or manner == MANNERS[0] else LEARNED
    speed = HALF if manner == MANNERS[2] and beside is None else FULL
    proposal = etude.ask(campaign, control=control, speed=speed, go_on=True)
    plan = from_json((proposal.folder / "trajectory.json").read_bytes())
    log = robot.run(plan, beside, np.random.default_rng([seed, proposal.number, RUN_STREAM]))
    path = campaign.path / f"{proposal.number:04d}.parquet"
    write_log(path, log)
    etude.tell(campaign, path, number=proposal.number, control=control, accept=CERTAIN)
    certificate = json.loads((proposal.folder / "certificate.json").read_bytes())
    return {**_away(log, plan, certificate["rows"]), **_size(plan), "errors": _tested(campaign, robot)}


def _beside(campaign: Campaign) -> Controller | None:
    """What flies beside the feedback, once something was learned."""
    if not campaign.state().trained:
        return None
    model: Any = newest_model(campaign, campaign.state())
    controller: Controller | None = campaign.kind.collecting(campaign.spec, campaign.config, model)  # type: ignore[attr-defined]
    return controller


def _away(log: Log, plan: Trajectory, rows: Sequence[Facts]) -> dict[str, float]:
    """Largest distance from the plan along x, y or z, m, and in parts of the margin kept there."""
    margins = np.array([row["tracking_margin"] for row in rows if row["quantity"] == "position"])
    planned = plan.motion(np.clip(log.t, 0.0, plan.duration), 1).orders[0]
    away: Array = np.abs(log["position"] - planned).max(axis=0)
    return {"away": float(away.max()), "of margin": float((away / margins).max())}


def _size(plan: Trajectory) -> dict[str, float]:
    """How far the plan reaches along an axis, m, and its largest speed, m/s."""
    place, rate = plan.motion(np.linspace(0.0, plan.duration, INSTANTS), 2).orders[:2]
    extent, speed = np.ptp(place, axis=0).max(), np.linalg.norm(rate, axis=1).max()
    return {"extent": float(extent), "speed": float(speed)}


def _tested(campaign: Campaign, robot: Any) -> dict[str, float]:
    """Mean distance from the plan by test, m, as `etude simulate` measures it."""
    model: Any = newest_model(campaign, campaign.state())
    controller = campaign.kind.controller(campaign.spec, campaign.config, model)
    seed, errors = campaign.state().seed, {}
    for place, (name, motion) in enumerate(test_motions(campaign).items()):
        rng = np.random.default_rng([seed, place, TEST_STREAM, TEST_STREAM])
        errors[name] = float(robot.error(robot.test(motion, controller, rng))[0][-1])
    return errors


def summary(rows: Sequence[Facts]) -> str:
    """Two tables: what the flights did, and the errors after them over those of "one list"."""
    lines = [f"{'flights':<30}{'seeds':>6}{'beyond':>8}{'largest':>9}{'median m':>10}{'extent m':>10}"]
    for robot, manner in product(ROBOTS, MANNERS):
        selected = _of(rows, robot, manner)
        for flight in range(_flights(selected) if len(selected) > 1 else 0):
            lines.append(
                _line(f"{robot}, {manner}, {flight + 1}", [r["flights"][flight] for r in selected.values()])
            )
    for robot, manner in product(ROBOTS, MANNERS[1:]):
        selected, other = _of(rows, robot, manner), _of(rows, robot, MANNERS[0])
        both, seeds = (selected, other), sorted(selected.keys() & other.keys())
        for flight in range(min(_flights(selected), _flights(other)) if len(seeds) > 1 else 0):
            lines += [
                f"{robot}, {manner} over one list, after {flight + 1}, {test}: "
                f"{_ratio([[r[s]['flights'][flight]['errors'][test] for s in seeds] for r in both])}"
                for test in selected[seeds[0]]["flights"][flight]["errors"]
            ]
    return "\n".join(lines)


def _of(rows: Sequence[Facts], robot: str, manner: str) -> dict[int, Facts]:
    return {row["seed"]: row for row in rows if (row["robot"], row["onset"]) == (robot, manner)}


def _flights(rows: Mapping[int, Facts]) -> int:
    """That all campaigns have."""
    return min(len(row["flights"]) for row in rows.values())


def _line(name: str, flights: Sequence[Facts]) -> str:
    part, away, extent = (np.array([f[key] for f in flights]) for key in ("of margin", "away", "extent"))
    figures = f"{part.max():>9.2f}{np.median(away):>10.2f}{extent.mean():>10.1f}"
    return f"{name:<30}{len(flights):>6}{int((part > 1.0).sum()):>8}{figures}"


def _ratio(pair: Sequence[Sequence[float]]) -> str:
    ratio = paired(*pair)
    means = [float(np.mean(errors)) for errors in pair]
    return (
        f"{means[0]:.3f} m, {means[1]:.3f} m, ratio {ratio.ratio:.2f} ({ratio.low:.2f} .. {ratio.high:.2f}), "
        f"{ratio.count} seeds"
    )


def main(path: Path, first: int, seeds: int, flights: int = FLIGHTS) -> None:
    """Runs what FILE lacks, and prints the tables."""
    done = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done_cases = {(row["robot"], row["onset"], row["seed"]) for row in done}
    cases = [Case(*one) for one in product(ROBOTS, MANNERS, range(first, first + seeds))]
    with path.open("a") as file:
        for case in cases:
            if (case.robot, case.manner, case.seed) not in done_cases:
                done.append({**vars(case), "flights": campaign_of(case, flights)})
                file.write(json.dumps(done[-1]) + "\n")
                file.flush()
    print(summary(done))  # noqa: T201


if __name__ == "__main__":
    own = [int(word) for word in sys.argv[2:5]]
    main(Path(sys.argv[1]), *(own or (FIRST, SEEDS)))
