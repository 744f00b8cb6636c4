"""Which samples logs give together, in which groups, and which logs a simulated robot left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import Round, State
from etude.campaign.record.stored import stored_log
from etude.types import Samples


def told_samples(campaign: Campaign, numbers: Sequence[int]) -> Samples:
    """The samples of stored logs; each segment is a group, in the order of `numbers` and of time.

    A log that repeats another of them is in that one's groups: it is no new evidence of how well a new motion
    is predicted.
    """
    logs = [stored_log(campaign, number) for number in numbers]
    groups = []
    for log, own in zip(logs, groups_of(campaign, numbers).values(), strict=True):
        place = np.searchsorted([start for start, _ in own], log.t, side="right") - 1
        groups.append(np.array([group for _, group in own], dtype=np.int64)[np.maximum(place, 0)])
    return campaign.kind.samples(campaign.spec, campaign.config, logs, groups)


def groups_of(campaign: Campaign, numbers: Sequence[int]) -> dict[int, list[tuple[float, int]]]:
    """Of each of those logs, when its segments start, s, and their groups; a repeated one has its own."""
    rounds, count = campaign.state().rounds, 0
    found: dict[int, list[tuple[float, int]]] = {}
    for number in numbers:
        told = rounds[number].told
        starts = told.segments if told else (0.0,)
        repeats = found.get(told.repeats) if told and told.repeats is not None else None
        last = 0 if repeats is None else len(repeats) - 1
        found[number] = [
            (start, count + i if repeats is None else repeats[min(i, last)][1])
            for i, start in enumerate(starts)
        ]
        count += len(starts) if repeats is None else 0
    return found


def known_groups(campaign: Campaign, numbers: Sequence[int]) -> int:
    """How many groups those logs make."""
    return len({group for own in groups_of(campaign, numbers).values() for _, group in own})


SIMULATED = "simulated"
"""The folder of a campaign with the logs that its simulated robot left."""


def simulated_logs(campaign: Campaign, state: State) -> list[Round]:
    """Rounds in use whose log came out of `etude simulate`, by number."""
    return [r for r in state.told if _left(campaign, r)]


def real_logs(campaign: Campaign, state: State) -> list[Round]:
    """Rounds in use whose log came from elsewhere, by number."""
    return [r for r in state.told if not _left(campaign, r)]


def mixed(campaign: Campaign, state: State) -> tuple[str, ...]:
    """A sentence where a model learns from a robot and from what was made of its model file.

    A built-in robot has a plant of its own: nothing else is real of it.
    """
    simulated, real = simulated_logs(campaign, state), real_logs(campaign, state)
    if not simulated or not real or getattr(campaign.spec, "plant", None) is not None:
        return ()
    numbers = ", ".join(str(r.number) for r in simulated)
    return (
        f"log {numbers} was simulated, log {real[0].number} is of the robot itself: the model learns from two"
        f" robots. Take the simulated ones back: etude untell {campaign.path} {simulated[-1].number}",
    )


def _left(campaign: Campaign, one: Round) -> bool:
    return (campaign.path / SIMULATED / f"{one.number:04d}.parquet").is_file()
