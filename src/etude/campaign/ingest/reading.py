"""Reads a log of a robot that was named, not described."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from etude.campaign.ingest.questions import Answers, Asked
from etude.campaign.record.folder import Campaign
from etude.campaign.simulate.create import find_robot
from etude.logs.cleaning import read as logs
from etude.types import Log


def read_log(
    path: str | Path, robot: Campaign | str | Path, *, degrees: bool = False, topics: Sequence[str] = ()
) -> Log:
    """The log in a file: columns matched by name, units checked, rows repaired, a sentence for each repair.

    Args:
        path: a file or folder of a format that `etude plugins` lists under etude.readers.
        robot: whose log it is: an open campaign, a built-in name, or the path of a description.
        degrees: the file's angles are degrees.
        topics: of a file that holds several; none: those that the campaign names, or that look right.

    Raises:
        DataError: the log cannot be used; says what, where, and what to do.
        UsageError: there is no such robot.
    """
    if isinstance(robot, Campaign):
        kind, spec, config = robot.kind, robot.spec, robot.config.log
    else:
        config = None
        kind, place = find_robot(str(robot))
        spec = kind.spec(place)
    known = kind.expected(spec)
    return logs.read_log(
        path,
        kind.channels(spec),
        rate=known.rate,
        degrees=degrees,
        limits=known.limits,
        settle=Asked(kind, spec, Answers()).motion,
        topics=topics,
        config=config,
    )
