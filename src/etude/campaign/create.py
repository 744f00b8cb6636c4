"""Creation of a self-contained campaign folder."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from etude import plugins
from etude._runtime.trusted_folders import folder_id, is_trusted, trust_own
from etude._runtime.trusted_folders import trust as add_trust
from etude.abilities import SupportsSelection
from etude.campaign.record.config import preset_config
from etude.campaign.record.config_file import CONFIG, config_text, load_config
from etude.campaign.record.events import Created
from etude.campaign.record.folder import (
    ROBOT,
    Campaign,
    names_of,
    open_campaign,
    require_no_remains,
    require_plain,
)
from etude.campaign.record.journal import JOURNAL, commit, read_events
from etude.errors import UsageError, did_you_mean, reason, typed
from etude.plugins import named_in
from etude.protocols import Kind
from etude.storage import LOCK, sha256_of, write_atomic, writer_lock
from etude.toml_tables import decoded, read_text
from etude.types import Described

GROUP = "etude.robots"
T = TypeVar("T")


@dataclass(frozen=True)
class RobotPart:
    """Part of a description to use, for kinds with a selection; see `abilities.SupportsSelection`."""

    joints: tuple[str, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    mesh_roots: tuple[Path, ...] = ()
    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    floor: float | None = None
    joint_limits: Path | None = None


WHOLE = RobotPart()


def create_campaign(
    path: str | Path,
    robot: str | Path,
    preset_name: str = "default",
    seed: int = 0,
    part: RobotPart = WHOLE,
    *,
    trust: bool = False,
) -> tuple[Campaign, tuple[str, ...]]:
    """Make the folder: robot.toml and its files, campaign.toml, and the journal's first event.

    Args:
        path: the folder; made if missing.
        robot: a built-in robot's name, or the path of a description that some kind of robot recognises.
        preset_name: of the kind, "default" or "thesis"; all of its values are written to the file.
        seed: of every random number in the campaign.
        part: selected part of the description.
        trust: run code that the description names as module:attribute (a custom limit).

    Returns:
        the campaign, and one sentence for each assumption that the user should confirm.

    Raises:
        UsageError: a campaign or conflicting files exist already; the folder cannot be made; or the robot is
            unknown or impossible.
    """
    path, robot = Path(path), str(robot)
    _require_empty(path)  # before the robot is read, which takes seconds
    kind, description = find_robot(robot)
    with reading(description, trust=trust):
        described = kind.described(description) if part == WHOLE else _chosen(kind, description, part)
    if ROBOT in described.files:
        require_plain(names_of(decoded(described.files[ROBOT].decode(), robot)), robot)
    config = replace(preset_config(kind, preset_name), seed=seed)
    text = config_text(config, kind).encode()
    files = {**described.files, CONFIG: text}
    with _removed_on_failure(path, files):
        _make_folder(path)
        with writer_lock(path):
            _require_empty(path)
            _require_free(path, files)
            written = _write_description(path, described)
            with reading(description, trust=trust):
                spec = kind.spec(path / ROBOT)
            axes = next(c.parts for c in kind.channels(spec) if c.name == kind.path)
            write_atomic(path / CONFIG, text)
            fact = Created(seed=seed, preset=preset_name, kind=kind.name, robot=spec.name, axes=tuple(axes))
            # campaign.toml is not listed: people may edit it, and its hash is in every event anyway
            config_sha256, robot_sha256 = load_config(path).sha256, sha256_of(path / ROBOT)
            commit(path, fact, files=written, config_sha256=config_sha256, robot_sha256=robot_sha256)
    trust_own(path, folder_id(path / JOURNAL))
    return open_campaign(path), described.confirm


def _require_empty(path: Path) -> None:
    """Raise UsageError if the folder holds a campaign, or remains of one."""
    if os.path.isfile(path / JOURNAL) and read_events(path):
        raise UsageError(
            "this folder already holds a campaign",
            where=str(path),
            next_step=f"Continue it: etude status {typed(path)} shows the next step. Or name another folder.",
        )
    require_no_remains(path)


def _require_free(path: Path, files: Mapping[str, bytes]) -> None:
    """Raise UsageError if a file of that name has other contents: `init` never overwrites a user's file.

    An interrupted `init` leaves the same contents, and the same command finishes it.
    """
    for name, data in files.items():
        if (path / name).exists() and (not (path / name).is_file() or (path / name).read_bytes() != data):
            raise UsageError(
                f"this folder holds another {name}, which a campaign would replace",
                where=str(path / name),
                next_step="Name another folder for the campaign, which gets a copy of the robot's "
                "description.",
            )


def _chosen(kind: Kind, description: Path, part: RobotPart) -> Described:
    if not isinstance(kind, SupportsSelection):
        raise UsageError(
            f"robots of the kind '{kind.name}' have no joints to choose from",
            where=str(description),
            next_step="Leave --joints, --hold, --mesh-root, --range, --velocity, --acceleration, "
            "--command, --joint-limits and --floor out.",
        )
    options = part.joints, part.held, part.mesh_roots, part.limits, part.floor, part.joint_limits
    return kind.chosen(description, *options)


def load_robot(robot: str | Path, *, trust: bool = False) -> Any:
    """The description of a built-in robot or of a file; trust: run code that it names.

    Raises:
        UsageError: as `find_robot`; or the file names code as module:attribute and is not trusted.
    """
    kind, path = find_robot(str(robot))
    with reading(path, trust=trust):
        return kind.spec(path)


@contextlib.contextmanager
def reading(path: Path, *, trust: bool = False) -> Iterator[None]:
    """Context for names of code in a robot file outside of campaigns; see `plugins.named_in`."""
    if trust:
        yield
        return
    command = f"etude init FOLDER --robot {path} --trust; in Python, trust=True"
    with named_in(path, path, sha256_of(path), command):
        yield


def trust_robot(robot: str) -> None:
    """Add a robot's file to this user's list of trusted files. OSError: the list cannot be written."""
    _, path = find_robot(robot)
    if not is_trusted(path, sha256_of(path)):
        add_trust(path, sha256_of(path))


def _shipped(path: Path) -> str:
    """Where the package has that example; "" if it has none."""
    example = Path(__file__).parents[1] / path
    return f"It is a built-in robot: {example}. " if not path.is_absolute() and example.is_file() else ""


def find_robot(robot: str) -> tuple[Kind, Path]:
    """The kind and the description of a built-in name, or of a file that one kind recognises.

    Raises:
        UsageError: no such name or file, a folder, or a file that no kind, or more than one, recognises.
    """
    kinds, broken = _kinds()
    built_in = {kind.name: _call_plugin(kind.name, kind.built_in, broken) or {} for kind in kinds}
    names = {name: (kind, path) for kind in kinds[::-1] for name, path in built_in[kind.name].items()}
    if robot in names:
        return names[robot]
    path = Path(robot)
    choices = f"Built-in robots: {', '.join(sorted(names))}; or name the file that describes your robot."
    if path.is_dir():
        raise UsageError("this is a folder, not a robot's description", where=robot, next_step=choices)
    if not path.is_file():
        raise UsageError(
            f"there is no robot and no file {robot!r}",
            next_step=(_shipped(path) or did_you_mean(robot, names)) + choices,
        )
    matches = [kind for kind in kinds if _call_plugin(kind.name, partial(kind.recognises, path), broken)]
    if not matches:
        _require_known_kind(path, [*(kind.name for kind in kinds), *broken])
        hint = "".join(f" {name} cannot be used: {why}." for name, why in broken.items())
        raise UsageError(
            f"this file describes no known kind of robot ({', '.join(k.name for k in kinds)})",
            where=robot,
            next_step=f'A TOML file states its kind, for example: kind = "{kinds[0].name}".{hint}',
        )
    if len(matches) > 1:
        raise UsageError(
            f"this file fits several kinds of robot: {', '.join(k.name for k in matches)}",
            where=robot,
            next_step='Write kind = "..." with one of them in its first line.',
        )
    return matches[0], path


def _require_known_kind(path: Path, kinds: Sequence[str]) -> None:
    """Raise UsageError if the file is unreadable TOML, or names an unknown kind."""
    if path.suffix.lower() != ".toml":
        return
    named = decoded(read_text(path), str(path)).get("kind")
    if isinstance(named, str) and named not in kinds:
        raise UsageError(
            f"no kind of robot {named!r} is known ({', '.join(kinds)})",
            where=f"{path}, kind",
            next_step=f"{did_you_mean(named, kinds)}Correct the name, or install the plug-in of that kind; "
            "etude plugins lists all.",
        )


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise UsageError(
            "this path is a file or lies below a file",
            where=str(path),
            next_step="Name another folder.",
        ) from None
    except OSError as error:
        raise UsageError(
            f"the folder cannot be made: {error.strerror or error}",
            where=str(path),
            next_step="Name another folder that you may write to.",
        ) from None


def _kinds() -> tuple[list[Kind], dict[str, str]]:
    """All kinds that can be loaded, and the reasons why others cannot; a broken plug-in affects no other."""
    kinds: list[Kind] = []
    broken: dict[str, str] = {}
    for name in plugins.names(GROUP):
        try:
            kinds.append(plugins.load(GROUP, name))
        except UsageError as error:
            broken[name] = error.fact
    return kinds, broken


def _call_plugin(name: str, question: Callable[[], T], broken: dict[str, str]) -> T | None:
    """The answer of a kind; None, and the reason in `broken`, where a plug-in fails."""
    try:
        return question()
    except Exception as problem:
        if name in plugins.BUILT_IN[GROUP]:
            raise
        broken[name] = reason(problem)
        return None


@contextlib.contextmanager
def _removed_on_failure(folder: Path, files: Mapping[str, bytes]) -> Iterator[None]:
    """Context that, on failure, removes the files written in it and the folder if it was made."""
    new = [folder / name for name in files if not (folder / name).exists()]
    above = [directory for directory in (folder, *folder.parents) if not directory.exists()]
    try:
        yield
    except Exception:
        with contextlib.suppress(OSError):  # no folder was made, or it contains other files by now
            for file in [*new, *([folder / LOCK] if above else ())]:
                file.unlink(missing_ok=True)
            for directory in above:
                directory.rmdir()
        raise


def _write_description(folder: Path, described: Described) -> list[Path]:
    """Write the description's files, robot.toml last, since only that file makes a campaign."""
    names = sorted(described.files, key=lambda name: name == ROBOT)
    for name in names:
        write_atomic(folder / name, described.files[name])
    return [folder / ROBOT, *(folder / name for name in names if name != ROBOT)]
