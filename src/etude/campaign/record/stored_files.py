"""Integrity of stored files: comparison with the journal before use, and renewal after a change of
robot.toml, campaign.toml or the model.

Facts shown about a file are computed from its bytes on the disk at that moment. Two rules apply. A file that
was changed by hand is refused by name. A file with other contents today is written anew, committed, and
named.

Every event holds the hashes of robot.toml and campaign.toml. `ask` and `tell` use the edited files, and
commit an event of the edit if they commit nothing else.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from etude.campaign.record.config_file import CONFIG
from etude.campaign.record.events import (
    Asked,
    Changed,
    Confirmed,
    Created,
    Edited,
    Event,
    Exported,
    Ingested,
    Trained,
)
from etude.campaign.record.folder import ROBOT, Campaign
from etude.campaign.record.journal import damaged, recorded, require_intact
from etude.codes import NextStep, Notice, OfFile
from etude.errors import UsageError, typed
from etude.protocols import Trajectory
from etude.storage import GENERATION, unreadable, write_atomic

MARK = "etude-export.json"
"""Says what the folder is: one that holds it may be replaced by the next export."""
EXPORTS = "exports"
"""Where in the campaign folders are written unless another is named."""


RESTORE = "Restore the file from a copy."


def name_of(campaign: Campaign, path: Path) -> str:
    """Name of a file in the journal."""
    return path.relative_to(campaign.path).as_posix()


def stored_bytes(campaign: Campaign, path: Path, next_step: str = RESTORE) -> bytes:
    """The bytes of a committed file, checked against the journal.

    Raises:
        FileNotFoundError: the journal does not know the file, or it is missing.
        UsageError: it was changed, or cannot be read.
    """
    name = name_of(campaign, path)
    digest = recorded(campaign.events()).get(name)
    if digest is None:
        raise FileNotFoundError(f"the journal has no entry of {name}")
    try:
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(f"{name} is missing") from None
    except OSError as error:
        raise unreadable(path, error) from error
    if hashlib.sha256(data).hexdigest() != digest:
        raise UsageError(f"{name} was changed after Étude stored it", where=str(path), next_step=next_step)
    return data


def is_committed(campaign: Campaign, path: Path) -> bool:
    """Whether the journal knows the file and it exists; a killed writer may leave one without an event."""
    return name_of(campaign, path) in recorded(campaign.events()) and path.exists()


def require_description(campaign: Campaign) -> None:
    """Checks the robot's files beside robot.toml: its model and its meshes. People edit robot.toml alone.

    Raises:
        UsageError: a file is missing or was changed.
    """
    created = next(e for e in campaign.events() if isinstance(e.fact, Created))
    hashes = {name: digest for name, digest in created.files.items() if name != ROBOT}
    advice = (
        f"{RESTORE} If the robot is now another one, create a separate campaign: etude init FOLDER --robot "
        "FILE."
    )
    require_intact(campaign.path, hashes, advice)


def require_runs(campaign: Campaign, numbers: Sequence[int]) -> None:
    """Checks the stored logs of these numbers. UsageError: one is missing or was changed; says which."""
    for number in numbers:
        name = name_of(campaign, campaign.run_file(number))
        digest = recorded(campaign.events()).get(name)
        hashes = {} if digest is None else {name: digest}
        require_intact(campaign.path, hashes, run_advice(campaign, number))


def run_advice(campaign: Campaign, number: int) -> str:
    """Next step if the stored log of that number is not the ingested one."""
    ingested = campaign.state().rounds[number].ingested
    log = ingested.source if ingested is not None else "LOG"
    return (
        f"Do not learn from it. {RESTORE[:-1]}, or remove the log and ingest the original again: etude "
        f"untell {typed(campaign.path)} {number}, then etude tell {typed(campaign.path)} {typed(log)}."
    )


def settle(
    campaign: Campaign, number: int, contents: Mapping[Path, bytes], fact: Exported, next_step: str = ""
) -> tuple[str, ...]:
    """Ensures that these files hold these bytes; returns a sentence if they were written anew.

    Files that the journal does not know, or that were all deleted, are written and committed. Other files
    must be as committed, or as in `contents`; those that differ from `contents` are then written anew and
    committed. The caller holds the writer's lock.

    Args:
        campaign: the folder. number: of the proposal.
        contents: path -> bytes, the certificate last. fact: to be committed with them.
        next_step: for a file that was changed. "": delete all of them and repeat the command, which writes
            them anew.

    Raises:
        UsageError: a file is missing or was changed; nothing is written.
    """
    events = campaign.events()
    hashes, existing = recorded(events), [path for path in contents if path.exists()]
    names = {path: name_of(campaign, path) for path in contents}
    committed = [path for path in contents if names[path] in hashes] if existing else []
    wrong = [path for path, data in contents.items() if not _holds(path, data)]
    # one that holds what is to be written needs no other witness: a writer may have been killed on its way
    held = {names[path]: hashes[names[path]] for path in committed if path in wrong}
    require_intact(campaign.path, held, next_step or _rewrite_advice(existing))
    if (
        not wrong
        and {names[path]: _digest(data) for path, data in contents.items()}.items() <= hashes.items()
    ):
        if _is_older(events, names):  # proved again, by this generation
            campaign.commit(fact, number, list(contents))
        return ()
    for path in wrong:
        write_atomic(path, contents[path])
    campaign.commit(fact, number, list(contents))
    if not committed:
        return ()
    anew = wrong or committed
    folders = dict.fromkeys(name_of(campaign, path.parent) for path in anew)
    changed = changed_since(campaign, events, [names[path] for path in committed])
    older = "an earlier version wrote them" if _is_older(events, names) else "their inputs changed"
    why = f"{' and '.join(changed)} changed" if changed else older
    what = f"{', '.join(path.name for path in anew)} in {', '.join(folders)}"
    return (f"Written again, because {why}: {what}.",)


def _rewrite_advice(there: Sequence[Path]) -> str:
    """Next step for changed files that the same command writes again once all of them are deleted."""
    return (
        "Do not run it. Restore the file from a copy; or delete all files written with it, and run the "
        f"same command again: rm {shlex.join(str(path) for path in there)}"
    )


def changed_since(campaign: Campaign, events: Sequence[Event], names: Sequence[str]) -> tuple[str, ...]:
    """Which of robot.toml and campaign.toml changed since these files were committed, as far as the journal
    knows.

    Early events have no hash of robot.toml.
    """
    last = [next((e for e in reversed(events) if name in e.files), None) for name in names]
    commits = [e for e in last if e is not None]
    robot = any(e.robot_sha256 not in ("", campaign.robot_sha256) for e in commits)
    config = any(e.config_sha256 != campaign.config_sha256 for e in commits)
    return tuple(name for name, changed in ((ROBOT, robot), (CONFIG, config)) if changed)


def proved_otherwise(campaign: Campaign, numbers: Sequence[int]) -> list[Notice]:
    """A notice for each folder of these proposals whose certificate is for another robot.toml or
    campaign.toml.
    """
    events, notices = campaign.events(), []
    names = {
        name
        for e in events
        if isinstance(e.fact, Asked | Exported) and e.number in numbers
        for name in e.files
    }
    folders: dict[str, list[str]] = {}
    for name in sorted(names):
        if (campaign.path / name).is_file():
            folders.setdefault(name.rpartition("/")[0], []).append(name)
    for folder, files in folders.items():
        changed = changed_since(campaign, events, files)
        if changed:
            match = re.match(r"proposals/0*(\d+)", folder)
            number = int(match[1]) if match else 0
            again = number == max(numbers, default=0)  # the newest is what ask proves again
            fields = {"file": folder, "changed": changed, "folder": str(campaign.path), "number": number}
            fields["options"] = _options_of(campaign, events, folder)
            step = NextStep.ASK_AGAIN if again else NextStep.GIVE_UP
            notices.append(Notice(OfFile.PROVED_BEFORE, fields, step))
    return notices


def _options_of(campaign: Campaign, events: Sequence[Event], folder: str) -> str:
    """The options of `ask` that write a proposal's folder again; " --speed 50 --from home", for example.

    Each folder on the way to it has an option of its own: the speed, the pose, the format, which is the last.
    """
    parts, options = folder.split("/"), ""
    for n in range(3, len(parts) + 1):
        place = "/".join(parts[:n])
        facts = [e.fact for e in events if any(name.rpartition("/")[0] == place for name in e.files)]
        exported = [fact for fact in facts if isinstance(fact, Exported)]
        if exported and exported[-1].format:
            return f"{options} --format {exported[-1].format}{' --effort' if exported[-1].effort else ''}"
        options += _option(campaign.axes, exported[-1], parts[n - 1]) if exported else ""
    return options


def _option(axes: Sequence[str], fact: Exported, folder: str) -> str:
    if not fact.start:
        return f" --speed {fact.speed}"
    label = folder.removeprefix("from_")
    if not re.fullmatch("[0-9a-f]{8}", label):  # else the pose has no name
        return f" --from {label}"
    return f" --from {','.join(f'{axis}={x!r}' for axis, x in zip(axes, fact.start, strict=True))}"


def _holds(path: Path, data: bytes) -> bool:
    try:
        return path.read_bytes() == data
    except OSError:
        return False


def _is_older(events: Sequence[Event], names: Mapping[Path, str]) -> bool:
    """Whether an earlier generation wrote one of these files last."""
    last = [next((e for e in reversed(events) if name in e.files), None) for name in names.values()]
    return any(e is not None and e.generation < GENERATION for e in last)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


TAKE_UP = (Created, Edited, Asked, Ingested, Trained, Changed, Confirmed)
"""Events of `init`, `ask` and `tell`, beside `exported` of a proposal; other commands leave edits to them."""


def edited(campaign: Campaign, events: Sequence[Event]) -> list[Notice]:
    """A notice for robot.toml and campaign.toml each, if it was edited since the last event about it, and for
    each file of an exported model that was.
    """
    notices = []
    for name, (then, when) in _last_hashes(events).items():
        if then not in ("", _current_hashes(campaign)[name]):
            fields = {"file": name, "when": _format_time(when), "folder": str(campaign.path)}
            notices.append(Notice(OfFile.EDITED, fields, NextStep.TAKE_UP))
    return [*notices, *_edited_exports(campaign)]


def exported_models(campaign: Campaign) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Folders of exported models that are still there, with their marks: in exports/, or by the journal."""
    elsewhere = {
        Path(e.fact.place)
        for e in campaign.events()
        if isinstance(e.fact, Exported) and e.number is None and e.fact.place
    }
    inside = [mark.parent for mark in sorted(campaign.path.glob(f"{EXPORTS}/*/{MARK}"))]
    for place in dict.fromkeys([*inside, *sorted(elsewhere)]):
        try:
            contents = json.loads((place / MARK).read_bytes())
        except (OSError, ValueError):
            continue  # it went to the robot, or was deleted
        if isinstance(contents, dict):
            yield place, contents


def _edited_exports(campaign: Campaign) -> list[Notice]:
    """A notice for each file of an exported model that has other contents now."""
    notices = []
    for place, mark in exported_models(campaign):
        files, target = mark.get("files"), str(mark.get("target", ""))
        output = "" if place == campaign.path / EXPORTS / target else f" --output {typed(place)}"
        own = {  # a stranger may have written the mark
            name: digest
            for name, digest in (files.items() if isinstance(files, dict) else ())
            if (place / name).resolve().is_relative_to(place.resolve())
        }
        for changed in (one for one in damaged(place, own) if one.code == OfFile.CHANGED):
            fields = {"file": str(place / str(changed.fields["file"])), "folder": str(campaign.path)}
            fields |= {"target": target, "output": output}
            notices.append(Notice(OfFile.EXPORT_EDITED, fields, NextStep.EXPORT_AGAIN))
    return notices


def take_up(campaign: Campaign) -> None:
    """Commits that both files are in use, unless the journal says so. The caller holds the lock."""
    now = _current_hashes(campaign)
    if any(then != now[name] for name, (then, _) in _last_hashes(campaign.events()).items()):
        campaign.commit(Edited())


def _current_hashes(campaign: Campaign) -> Mapping[str, str]:
    return {ROBOT: campaign.robot_sha256, CONFIG: campaign.config_sha256}


def _last_hashes(events: Sequence[Event]) -> Mapping[str, tuple[str, str]]:
    """Hash and time of both files at their last event; the hash is "" where no event has it."""
    robot = config = ("", "")
    for event in events:
        of_proposal = isinstance(event.fact, Exported) and event.number is not None
        if isinstance(event.fact, TAKE_UP) or of_proposal:
            digest = event.robot_sha256 or event.files.get(ROBOT)
            robot = robot if digest is None else (digest, event.time)
            config = event.config_sha256, event.time
    return {ROBOT: robot, CONFIG: config}


def _format_time(time: str) -> str:
    """2026-11-26 00:51 UTC."""
    return f"{datetime.fromisoformat(time):%Y-%m-%d %H:%M} UTC"


FULL = 100
"""%, of the speed that was asked for."""


def stored_trajectory(campaign: Campaign, number: int, speed: int = FULL) -> Trajectory:
    """The trajectory of a proposal, or its slower copy, from its file.

    Raises:
        UsageError: the file is missing, unknown to the journal, or was changed.
    """
    from etude.deploy.trajectory_files import COEFFICIENTS
    from etude.trajectories.json_text import from_json

    path = speed_folder(campaign, number, speed) / COEFFICIENTS
    try:
        return from_json(stored_bytes(campaign, path, proposal_advice(campaign, number)))
    except FileNotFoundError:
        raise UsageError(f"there is no proposal {number} at {speed} %", where=str(path)) from None


def proposal_advice(campaign: Campaign, number: int) -> str:
    """Next step if a file of a proposal differs from the committed one."""
    return (
        "Do not run it. Restore the file from a copy, or close the trajectory and write another: etude "
        f"abandon {typed(campaign.path)} {number}, then etude ask {typed(campaign.path)}."
    )


def speed_folder(campaign: Campaign, number: int, speed: int) -> Path:
    """Folder of a proposal's files at this speed (per cent)."""
    folder = campaign.proposal(number)
    return folder if speed == FULL else folder / f"speed_{speed:03d}"
