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
    """One row of `etude study list`.

    Attributes:
        id: its name on the command line. what: one line for people.
        seeds: number of seeds with results in the package.
        verdict: the word of a claim's verdict; "" if it has none.
        command: the command line that computes it.
    """

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
class StudiesPackage(Protocol):
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
            raise UsageError(f"{what} {name!r} does not take {flag}", where=flag, next_step="Leave it out.")
    function(**options, **more, **{key: value for key, value in optional.items() if key in taken})


def require_studies(what: str = "study") -> None:
    """UsageError with the command that installs them: there are none. what: the command that needs them."""
    if not plugins.names(GROUP):
        raise UsageError(
            f"the {BROUGHT[what]} are in a separate package, etude-studies, which is not installed",
            where=f"etude {what}",
            next_step="In a checkout of Étude: pip install ./packages/etude-studies",
        )


def functions() -> dict[str, str]:
    """Studies that are a function each: name -> what the first line of its module says."""
    lines = {}
    for name, study in _load_studies().items():
        if not isinstance(study, StudiesPackage):
            text = inspect.getdoc(inspect.getmodule(study)) or ""
            lines[name] = text.partition("\n")[0].partition(": ")[2]
    return lines


def rooms() -> list[StudiesPackage]:
    """Studies of many ids."""
    return [room for room in _load_studies().values() if isinstance(room, StudiesPackage)]


def _load_studies() -> dict[str, Any]:
    """Studies that can be loaded; `etude plugins` lists the problems of the others."""
    studies = {}
    for name in _study_names("study"):
        with suppress(UsageError):
            studies[name] = plugins.load(GROUP, name)
    return studies


def room_of(id: str) -> StudiesPackage | None:
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
    """Tables, figures and claims of the thesis, and other studies: list them, run or show one, or write pages
    of all."""

    prints: ClassVar[bool] = True

    action: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="list|run|show|report")]
    """list: every id with its seeds and verdict; run ID: compute it, or continue an interrupted run; show ID:
    the results that come with Étude; report: pages of all results."""

    id: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ID")] = ""
    """Study to run or show: table-6.9, figure-5.1, C6.2-3, thesis, or another one."""

    seed: int = 0
    """The first seed."""

    seeds: int | None = None
    """Number of seeds, counted from the first. Default: as planned for the study."""

    folder: Path = Path("results")
    """Folder of the results. An interrupted run continues from it."""

    workers: int | None = None
    """Number of processes. Default: one per core."""

    cluster: str = ""
    """tcp://host:port of a Dask scheduler, to compute there."""

    shard: str = ""
    """i/n: only part i of n, for array jobs of a batch system."""

    method: str = ""
    """module:factory of your model, kernel or criterion, in place of the method of each row."""

    logs: Path | None = None
    """Compute a table of models (6.1 to 6.9) on this recorded log of an arm instead. --seeds is then the
    number of folds."""

    robot: Path | None = None
    """robot.toml of that log. Default: FOLDER.toml beside the log."""

    limit_s: float | None = None
    """Time limit of one run in seconds. A run that exceeds it is stopped and reported."""

    go_on: bool = False
    """Do not compute again the results that come with Étude."""

    output: Path = Path("study-site")
    """Folder for the pages of report."""

    paper: Path | None = None
    """report: also write every table and curve as PDF and SVG into this folder."""

    update: bool = False
    """report, for maintainers: first copy the results of the folder into the sources."""

    serve: bool = False
    """report: show the pages in a browser on this machine, with the results so far, until Ctrl-C. No file is
    written."""

    port: int | None = None
    """Port for --serve. Default: a free one."""

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
            raise UsageError(
                f"the number of seeds must be 1 or more, not {self.seeds}",
                where="--seeds",
                next_step="Give 1 or more.",
            )
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
    """Measure the speed or accuracy of a part of Étude."""

    prints: ClassVar[bool] = True

    name: Annotated[str, tyro.conf.Positional]
    """Name of the bench. An unknown name lists all."""

    seed: int = 0
    """Seed of all random numbers."""

    quick: bool = False
    """Fewer seeds, in benches with several: all figures of models within three minutes. gp: other libraries
    only up to n = 1000."""

    python: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Interpreter of another environment, for libraries that gp compares with and that are not installed
    here. They are timed in a separate process. Can be given several times."""

    logs: Path | None = None
    """Folder with recordings that are not part of the project, for the benches models, truth, changed and
    watch (docs/real_logs.md)."""

    def run(self, _: Say) -> Outcome:
        options = {"json": self.json, "seed": self.seed}
        optional = {"quick": self.quick, "pythons": self.python, "logs": self.logs}
        run_study("bench", self.name, options, optional)
        return Outcome("")
