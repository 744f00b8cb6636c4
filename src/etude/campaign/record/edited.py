"""robot.toml and campaign.toml, which people edit: whether they did since the campaign took them up last.

Every event has the hashes of both as they were. `ask` and `tell` work by what the files say, so they take an
edit up, and commit an event of their own where nothing else of theirs was to be committed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime

from etude.campaign.record.config_file import CONFIG
from etude.campaign.record.folder import ROBOT, Campaign
from etude.campaign.record.journal import ROBOT_SHA256, Event

TAKE_UP = ("created", "edited", "asked", "told", "trained", "changed", "confirmed")
"""Events of `init`, `ask` and `tell`, beside `exported` of a proposal; other commands leave edits to them."""


def edited(campaign: Campaign, events: Sequence[Event]) -> list[str]:
    """A sentence for each of both files that is another than when it was taken up last."""
    found = []
    for name, (then, when) in _taken_up(events).items():
        if then not in ("", _now(campaign)[name]):
            found.append(
                f"{name} was edited since Étude took it up ({_in_words(when)}). The next ask or tell takes "
                f"up what it says now; ask proves an open motion again: etude ask {campaign.path}"
            )
    return found


def take_up(campaign: Campaign) -> None:
    """Commits that both files were taken up as they are, unless the journal says so. The caller holds the
    lock.
    """
    now = _now(campaign)
    if any(then != now[name] for name, (then, _) in _taken_up(campaign.events()).items()):
        campaign.commit("edited", None, [])


def _now(campaign: Campaign) -> Mapping[str, str]:
    return {ROBOT: campaign.robot_sha256, CONFIG: campaign.config_sha256}


def _taken_up(events: Sequence[Event]) -> Mapping[str, tuple[str, str]]:
    """Hash and time of both when they were taken up; the hash is "" where no event tells it."""
    robot = config = ("", "")
    for event in events:
        if event.event in TAKE_UP or (event.event == "exported" and event.number is not None):
            own = event.facts.get(ROBOT_SHA256, event.files.get(ROBOT))
            robot = robot if own is None else (own, event.time)
            config = event.config_sha256, event.time
    return {ROBOT: robot, CONFIG: config}


def _in_words(time: str) -> str:
    """2026-11-26 00:51 UTC."""
    return f"{datetime.fromisoformat(time):%Y-%m-%d %H:%M} UTC"
