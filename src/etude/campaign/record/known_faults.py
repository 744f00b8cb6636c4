"""Known faults in files of earlier versions: each is named, with the command that makes the file again.

Every file states its generation (`etude.storage`); a file without one is of the first generation. A fault is
reported only where it applies, and only until its file is made again. docs/known_faults.md describes each for
people.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from etude.abilities import SupportsKnownFaults
from etude.campaign.record.events import Asked, Event, Exported, Promoted, Trained
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import EXPORTS, exported_models
from etude.errors import EtudeError, UsageError, typed


@dataclass(frozen=True)
class Fault:
    """One fault of earlier generations.

    Attributes:
        mended: first generation without the fault. what: description for people.
    """

    mended: int
    what: str


MOUNTING, CLAMPED, MOVING_END, HELD = "mounting", "clamped_physics", "moving_end", "held_joint"
GEAR = "gear"
FAULTS = {
    MOUNTING: Fault(
        2,
        "[mounting] was ignored, because the root link of the model file has the name world: gravity, "
        "clearances and torques are those of an upright robot",
    ),
    CLAMPED: Fault(
        2,
        "its physics, with gravity, are constant outside the positions of its training: commands are wrong "
        "there",
    ),
    MOVING_END: Fault(
        2,
        "its last row is in motion: a receiver that holds the last row leaves the limits",
    ),
    HELD: Fault(
        2,
        "a joint moved in no log, so its commands are those of its controller while it sagged",
    ),
    GEAR: Fault(
        3,
        "torques of joints whose actuator has a gear in the model file were divided by it, and compared with "
        "limits that were not",
    ),
}
TARGETS = ("c", "ros2", "onnx", "px4", "crazyflie")
"""Of exported models: those whose code clamped its inputs before the physics."""


@dataclass(frozen=True)
class Affected:
    """A file or folder with a known fault.

    Attributes:
        code: of the fault, as in the documentation. what: affected object, in words. path: of it.
        command: makes it again.
    """

    code: str
    what: str
    path: str
    command: str

    @property
    def sentence(self) -> str:
        """A sentence for people."""
        return (
            f"{self.what} ({self.path}) is of an earlier version: {FAULTS[self.code].what}. Do not use it. "
        )


def affected(campaign: Campaign, state: State) -> list[Affected]:
    """Everything in this campaign that has a known fault, motions first."""
    kind = campaign.kind
    of_robot = tuple(kind.mended(campaign.spec)) if isinstance(kind, SupportsKnownFaults) else ()
    if unknown := [code for code in of_robot if code not in FAULTS]:
        raise UsageError(
            f"the kind of robot {kind.name} names an unknown fault: {unknown[0]}",
            where=f"{type(kind).__name__}.mended",
            next_step=f"Correct the plug-in. Known faults: {', '.join(FAULTS)}.",
        )
    return [
        *_motions(campaign, state, of_robot),
        *_models(campaign, state, of_robot),
        *_exports(campaign, of_robot),
    ]


def _motions(campaign: Campaign, state: State, of_robot: Sequence[str]) -> Iterator[Affected]:
    """Proposals and their exports; the newest event of each folder counts."""
    folders: dict[str, Event] = {}
    for event in campaign.events():
        if isinstance(event.fact, Asked | Exported) and event.number is not None:
            folders |= {
                name.rpartition("/")[0]: event for name in event.files if name.endswith("certificate.json")
            }
    for folder, event in folders.items():
        number = event.number or 0
        one, certificate = state.rounds.get(number), campaign.path / folder / "certificate.json"
        if one is None or one.abandoned or not certificate.is_file():
            continue
        receiver = event.fact.format if isinstance(event.fact, Exported) else ""
        what = f"trajectory {number}" + f" for {receiver}" * bool(receiver)
        for code in _of_robot(event, of_robot):
            again = "" if one.open else " --new"
            yield Affected(code, what, folder, f"etude ask {typed(campaign.path)}{again}")
        if _is_before(event, MOVING_END) and _ends_in_motion(certificate):
            give_up = f"etude abandon {typed(campaign.path)} {number}, then " if one.open else ""
            yield Affected(MOVING_END, what, folder, f"{give_up}etude ask {typed(campaign.path)} --new")


def _ends_in_motion(certificate: Path) -> bool:
    """Whether the certificate says that the motion does not end at rest."""
    try:
        return json.loads(certificate.read_bytes()).get("at_rest") is False
    except (OSError, ValueError, AttributeError):
        return False


def _models(campaign: Campaign, state: State, of_robot: Sequence[str]) -> Iterator[Affected]:
    """The newest and the deployed model, if the robot's physics were wrong or the robot hardly moved."""
    path, events = campaign.path, campaign.events()
    trained = [e for e in events if isinstance(e.fact, Trained) and state.trained]
    for code in _of_training(campaign, trained[-1], of_robot) if trained else ():
        number = trained[-1].number or 0
        ingested = state.rounds[number].ingested if number in state.rounds else None
        log = ingested.source if ingested is not None else "LOG"
        again = f"etude untell {typed(path)} {number}, then etude tell {typed(path)} {typed(log)}"
        yield Affected(code, f"the model of log {number}", f"models/{number:04d}", again)
    promoted = [e for e in events if isinstance(e.fact, Promoted)]
    for code in _of_robot(promoted[-1], of_robot) if state.promoted and promoted else ():
        what = f"the promoted model of log {promoted[-1].number}"
        yield Affected(code, what, next(iter(promoted[-1].files), "promoted"), f"etude promote {typed(path)}")


def _of_training(campaign: Campaign, event: Event, of_robot: Sequence[str]) -> Iterator[str]:
    """Codes of the faults of a training."""
    yield from _of_robot(event, of_robot)
    if isinstance(event.fact, Trained) and _is_before(event, HELD) and _is_held(campaign, event.fact.logs):
        yield HELD


def _is_held(campaign: Campaign, numbers: Sequence[int]) -> bool:
    """Whether a joint moved in none of these logs; False if a log cannot be read, which `status` reports."""
    from etude.campaign.record.stored_models import held_commands, stored_log  # only old folders need them

    try:
        paths = [stored_log(campaign, number)[campaign.kind.path] for number in numbers]
    except EtudeError:
        return False
    return bool(held_commands(campaign, paths).any())


def _exports(campaign: Campaign, of_robot: Sequence[str]) -> Iterator[Affected]:
    """Exported models: those in exports/ by their mark, others by the journal."""
    for place, mark in exported_models(campaign):
        generation, target = int(mark.get("generation", 1)), str(mark.get("target", ""))
        where = place.relative_to(campaign.path) if place.is_relative_to(campaign.path) else place
        output = "" if place == campaign.path / EXPORTS / target else f" --output {typed(place)}"
        again = f"etude export {typed(campaign.path)} --to {target}{output}"
        for code in of_robot:
            if generation < FAULTS[code].mended:
                yield Affected(code, f"the model for {target}", str(where), again)
        if generation < FAULTS[CLAMPED].mended and target in TARGETS:
            yield Affected(CLAMPED, f"the model for {target}", str(where), again)


def _of_robot(event: Event, codes: Sequence[str]) -> list[str]:
    """Which of the faults of this robot's files the event's files have."""
    return [code for code in codes if _is_before(event, code)]


def _is_before(event: Event, code: str) -> bool:
    return event.generation < FAULTS[code].mended
