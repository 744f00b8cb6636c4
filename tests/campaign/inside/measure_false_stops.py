"""How often a supervisor stops a sound robot on ways to and from a motion, under the learned command.

    python tests/campaign/inside/measure_false_stops.py LAB --ways 200 > false_stops.jsonl

LAB is a campaign that `etude run` has taught on `mujoco:MODEL,virtual`. Its newest model is sent
between random poses, and bounds are those of use. One line of JSON a way: why it was stopped, and the largest
residual of commands and error of position, in parts of their bounds.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from etude.campaign import Campaign, newest_model, open_campaign
from etude.campaign.run.certified_motions import CertifiedMotion, Learned, proposal_motion, transfers_of
from etude.campaign.run.run_settings import read_settings
from etude.drivers import Player, Reaction, Supervisor, find_driver
from etude.errors import UnsafeTrajectoryError
from etude.trajectories import PointToPoint

WIDEST = 2.5
"""rad or m of poses that are drawn."""


def drawn_ways(campaign: Campaign, motion: CertifiedMotion, seed: int) -> Iterator[CertifiedMotion]:
    """From the motion's end to a random pose, and from there to its start, for ever."""
    rng = np.random.default_rng(seed)
    low, high = campaign.kind.expected(campaign.spec).limits[campaign.kind.path]
    low, high = np.maximum(low, -WIDEST), np.minimum(high, WIDEST)
    while True:
        try:
            found = transfers_of(campaign, motion, low + rng.uniform(0.1, 0.9, len(low)) * (high - low))
        except UnsafeTrajectoryError:
            continue
        if found.approach is not None and found.back is not None:
            yield found.back
            yield found.approach


def watched(campaign: Campaign, player: Player, way: CertifiedMotion) -> dict[str, Any]:
    """One way, under the supervisor."""
    about = player.about()
    sent = way.for_driver(campaign, about)
    order = np.argsort([about.joints.index(axis) for axis in campaign.axes])
    predicted = way.predicted(sent.t)
    assert predicted is not None
    own = way.bounds(campaign, about)
    bounds = replace(own, **{k: v[order] for k, v in vars(own).items() if isinstance(v, np.ndarray)})
    supervisor = Supervisor(bounds, about, sent, predicted[:, order])
    recording = player.play(sent, supervisor.watch, "learned")
    moves = (recording.at > 0.0) & (recording.at < recording.reached)
    expected = way.predicted(recording.at[moves])
    assert expected is not None
    left = recording.command[moves] - expected[:, order]
    rows = max(1, round(0.1 * about.rate))
    total = np.cumsum(np.vstack([np.zeros_like(left[:1]), left]), axis=0)
    residual = np.abs(total[rows:] - total[:-rows]).max(axis=0) / rows
    error = np.abs(recording.q - recording.asked)[moves].max(axis=0)
    return {
        "part": way.part,
        "ended": recording.ended.value,
        "reason": supervisor.reason,
        "residual": float((residual / bounds.residual).max()) if bounds.residual is not None else None,
        "error": float((error / bounds.error).max()),
    }


def slowly(campaign: Campaign, player: Player, way: CertifiedMotion) -> None:
    """To the start of a way, wherever the robot is, unwatched."""
    about, here = player.about(), player.where().asked
    assert here is not None
    columns = [about.joints.index(axis) for axis in campaign.axes]
    path = PointToPoint(np.array([here[columns], way.start]), 0.4, dwell=0.1, peak_acceleration=1.0)
    data = path.to_json().encode()
    motion = replace(way, data=data, trajectory=path).for_driver(campaign, about)
    player.play(motion, lambda _: Reaction.GO, "learned")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("lab", type=Path)
    parser.add_argument("--ways", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    own = parser.parse_args()
    campaign = open_campaign(own.lab)
    number = max(event.number for event in campaign.events() if event.number)
    motion, model = proposal_motion(campaign, number, "learned"), newest_model(campaign, campaign.state())
    driver = read_settings(campaign)
    stopped = 0
    with find_driver(driver.on, campaign.axes, driver.driver) as player:
        for way in islice(drawn_ways(campaign, motion, own.seed), own.ways):
            slowly(campaign, player, way)
            learned = Learned.along(campaign, model, way, player.about())
            found = watched(campaign, player, replace(way, learned=learned))
            stopped += bool(found["reason"])
            print(json.dumps(found), flush=True)
    print(f"{stopped} of {own.ways} ways were stopped", file=sys.stderr)


if __name__ == "__main__":
    main()
