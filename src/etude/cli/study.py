"""etude study, etude bench: found among the plug-ins and called"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Protocol, runtime_checkable

import tyro

from etude import plugins
from etude.cli.outcome import Common, Outcome, Say
from etude.cli.report import served
from etude.cli.terminal import width
from etude.errors import UsageError

if TYPE_CHECKING:
    from etude.report.live import Pages

ACTIONS = ("list", "run", "show", "report")
OPTIONS = (
    *("seed", "seeds", "folder", "workers", "cluster", "shard", "method", "limit_s", "go_on"),
    *("update", "paper", "robot", "logs"),
)
"""Of a study of many ids."""
LINE = "{:15} {:>5}  {:21}  {}"
LEAST_WIDTH = 24
"""Characters of what an id is about, however narrow the terminal."""
LISTED = ("what", "seeds", "verdict", "command")
SEEDS = 4
"""Of a study that does not plan its own."""


GROUP, BENCH = "etude.studies", "bench_"
BROUGHT = {"study": "studies", "bench": "benches", "learn": "processes and clusters that learn campaigns"}
"""What a command needs of the package of studies."""
FLAGS = {"pythons": "--python", "logs": "--logs", "method": "--method"}
"""Options that must not be given in vain."""


class ListedStudy(Protocol):
    """One row of `etude study list`: what it is asked for by, a line, committed seeds, a verdict's word."""

    @property
    def id(self) -> str: ...
    @property
    def what(self) -> str: ...
    @property
    def seeds(self) -> int: ...
    @property
    def verdict(self) -> str: ...
    @property
    def command(self) -> str: ...


@runtime_checkable
class StudyRoom(Protocol):
    """A study of many ids: an object in the place of a function. Text is for people, data for machines."""

    def rows(self) -> Sequence[ListedStudy]: ...
    def knows(self, id: str) -> bool: ...
    def refuse(self, id: str) -> UsageError: ...
    def run(
        self, id: str, options: Mapping[str, Any], say: Callable[[str], None]
    ) -> tuple[str, dict[str, Any]]: ...
    def show(self, id: str) -> tuple[str, dict[str, Any]]: ...
    def report(self, folder: Path, options: Mapping[str, Any]) -> tuple[str, dict[str, Any]]: ...
    def live(self, options: Mapping[str, Any]) -> Pages: ...


def run_study(
    what: str, name: str, options: Mapping[str, Any], optional: Mapping[str, Any], **more: Any
) -> None:
    """Runs the study or bench of that name, which prints its rows.

    Args:
        what: "study" or "bench".
        name: without the prefix of a bench.
        options: of each of them.
        optional: passed on only to a function that takes them.
        more: of each of them too.

    Raises:
        UsageError: there is none of that name, it cannot be loaded, or has no use for an option given.
    """
    require_studies(what)
    plugin_names = _study_names(what)
    if name not in plugin_names:
        listed = ", ".join(sorted(plugin_names)) or "none yet"
        raise UsageError(f"there is no {what} {name!r}", next_step=f"Known: {listed}.")
    function = plugins.load(GROUP, plugin_names[name])
    taken = inspect.signature(function).parameters
    for option, flag in FLAGS.items():
        if optional.get(option) and option not in taken:
            raise UsageError(f"{what} {name!r} has no use for {flag}", where=flag, next_step="Leave it out.")
    function(**options, **more, **{key: value for key, value in optional.items() if key in taken})


def require_studies(what: str = "study") -> None:
    """UsageError with the command that installs them: there are none. what: the command that needs them."""
    if not plugins.names(GROUP):
        raise UsageError(
            f"the {BROUGHT[what]} are in a package of their own, etude-studies, which is not installed",
            where=f"etude {what}",
            next_step="In a checkout of Étude: pip install ./packages/etude-studies",
        )


def functions() -> dict[str, str]:
    """Studies that are a function each: name -> what the first line of its module says."""
    lines = {}
    for name, study in _load_studies().items():
        if not isinstance(study, StudyRoom):
            text = inspect.getdoc(inspect.getmodule(study)) or ""
            lines[name] = text.partition("\n")[0].partition(": ")[2]
    return lines


def rooms() -> list[StudyRoom]:
    """Studies of many ids."""
    return [room for room in _load_studies().values() if isinstance(room, StudyRoom)]


def _load_studies() -> dict[str, Any]:
    """Studies that can be loaded; `etude plugins` lists the problems of the others."""
    studies = {}
    for name in _study_names("study"):
        with suppress(UsageError):
            studies[name] = plugins.load(GROUP, name)
    return studies


def room_of(id: str) -> StudyRoom | None:
    """The study that has this id."""
    return next((room for room in rooms() if room.knows(id)), None)


def no_study(id: str) -> UsageError:
    """Error for an unknown id."""
    return next(
        (room.refuse(id) for room in rooms()),
        UsageError(f"there is no study {id!r}", next_step=f"Known: {', '.join(functions())}."),
    )


def _study_names(what: str) -> dict[str, str]:
    """Name on the command line -> name of the plug-in."""
    names = plugins.names(GROUP)
    if what == "bench":
        return {name.removeprefix(BENCH): name for name in names if name.startswith(BENCH)}
    return {name: name for name in names if not name.startswith(BENCH)}


@dataclass(frozen=True, kw_only=True)
class Study(Common):
    """Tables, figures and claims of the thesis, and other studies: list them, run one, show what is known of
    one, or write all as pages.
    """

    prints: ClassVar[bool] = True

    action: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="list|run|show|report")]
    """list: every id with its seeds and verdict; run ID: compute it, or go on where it was stopped; show ID:
    the numbers that come with Étude; report: pages of all of them."""

    id: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ID")] = ""
    """What to run or show: table-6.9, figure-5.1, C6.2-3, thesis, or another study."""

    seed: int = 0
    """The first seed."""

    seeds: int | None = None
    """How many seeds, counted from the first; as many as are planned if not given."""

    folder: Path = Path("results")
    """Where results are kept; what was interrupted goes on from there."""

    workers: int | None = None
    """Processes; one a core if not given."""

    cluster: str = ""
    """tcp://host:port of a Dask scheduler that computes instead of this machine."""

    shard: str = ""
    """i/n: only the i-th of n parts, for the array jobs of a batch system."""

    method: str = ""
    """module:factory of a model, kernel or criterion of yours, in the place of the one of each row."""

    logs: Path | None = None
    """Compute a table of models (6.1 to 6.9) on this recorded log of an arm instead; --seeds counts folds."""

    robot: Path | None = None
    """Its robot.toml; FOLDER.toml beside the log if not given."""

    limit_s: float | None = None
    """Seconds that one run may take before it is ended and reported."""

    go_on: bool = False
    """Take the results that come with Étude as done."""

    output: Path = Path("study-site")
    """Where report writes its pages."""

    paper: Path | None = None
    """With report: also write every table and curve as PDF and SVG for publications into this folder."""

    update: bool = False
    """With report, for maintainers: commit the results of the folder to the sources first."""

    serve: bool = False
    """With report: show the pages in a browser of this machine instead, with the results that the folder has
    so far, until Ctrl-C; nothing is written."""

    port: int | None = None
    """Of --serve; a free one if not given."""

    def run(self, say: Say) -> Outcome:
        require_studies()
        if self.action not in ACTIONS:  # the short form of the studies that have one id each
            return self._run_one(self.action)
        if self.action == "list":
            return _listed()
        if self.action == "report":
            return self._served(say) if self.serve else self._report()
        if not self.id:
            raise UsageError(f"{self.action} what?", where="ID", next_step="etude study list shows all ids.")
        room = room_of(self.id)
        if room is None:
            if self.action == "run" and self.id in functions():
                return self._run_one(self.id)
            raise no_study(self.id)
        text, data = room.run(self.id, self._options, say) if self.action == "run" else room.show(self.id)
        return Outcome(text, data)

    def _run_one(self, name: str) -> Outcome:
        if self.seeds is not None and self.seeds < 1:
            raise UsageError(f"{self.seeds} seeds are none", where="--seeds", next_step="Give 1 or more.")
        options = {"json": self.json, "seed": self.seed, "seeds": SEEDS if self.seeds is None else self.seeds}
        run_study("study", name, options, {"method": self.method}, folder=self.folder / name)
        return Outcome("")

    def _report(self) -> Outcome:
        pages = [room.report(self.output, self._options) for room in rooms()]
        if not pages:
            raise UsageError("no study writes pages")
        return Outcome("\n".join(text for text, _ in pages), {"pages": [data for _, data in pages]})

    def _served(self, say: Say) -> Outcome:
        pages = [room.live(self._options) for room in rooms()]
        if not pages:
            raise UsageError("no study writes pages")
        return served(pages[0], self.port, self.json, say)

    @property
    def _options(self) -> dict[str, object]:
        return {name: getattr(self, name) for name in OPTIONS}


def _listed() -> Outcome:
    rows = [row for room in rooms() for row in room.rows()]
    data = [{"metric": row.id, **{name: getattr(row, name) for name in LISTED}} for row in rows]
    for name, what in functions().items():
        command = f"etude study run {name}"
        data.append({"metric": name, "what": what, "seeds": 0, "verdict": "", "command": command})
    lines = [LINE.format("id", "seeds", "verdict", "what")]
    for row in data:
        seeds, verdict = row["seeds"] or "-", row["verdict"] or "-"
        head = LINE.format(row["metric"], seeds, verdict, "")
        lines.append(head + _short(str(row["what"]), width() - len(head)))
    return Outcome("\n".join(lines), {"rows": data})


def _short(text: str, room: int) -> str:
    """The text, cut to that width."""
    room = max(LEAST_WIDTH, room)
    return text if len(text) <= room else f"{text[: room - 3]}..."


@dataclass(frozen=True, kw_only=True)
class Bench(Common):
    """Measure a part of Étude against what its machine can do at best."""

    prints: ClassVar[bool] = True

    name: Annotated[str, tyro.conf.Positional]
    """Which one; an unknown name lists them."""

    seed: int = 0
    """Of every random number."""

    quick: bool = False
    """Fewer seeds, where a bench has several: all figures of `models` within three minutes. In `gp` the other
    libraries only up to n = 1000."""

    python: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """The interpreter of another environment, for libraries that `gp` compares with and that are not in this
    one; can be given several times. They are timed in a process of their own."""

    logs: Path | None = None
    """Folder with recordings that are not part of the project, for `models`, `truth`, `changed`
    and `watch`: docs/real_logs.md."""

    def run(self, _: Say) -> Outcome:
        options = {"json": self.json, "seed": self.seed}
        optional = {"quick": self.quick, "pythons": self.python, "logs": self.logs}
        run_study("bench", self.name, options, optional)
        return Outcome("")
