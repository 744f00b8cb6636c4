"""A benchmark of methods: robot time until the error of the command is at most so many percent of its spread.

Ten robots: six simulated, and four recorded logs of the examples. An entry is one function from outside,

    def learn(lesson: Lesson) -> Callable[[Log], Array] | None

It gets the first seconds of a log, and returns what predicts commands (n, J) of states, or None: it refuses a
log that cannot be right. Commands of the test are never handed out. Another `--seed` draws other motions.

    etude study run robot_time --method my_entry:learn --folder results
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from etude import plugins
from etude.errors import DataError, EtudeError, UsageError
from etude.logs import seen
from etude.report import Html, document, element, paragraph, table
from etude.storage import write_atomic
from etude.threads import threads_for
from etude.types import Array, Log, Samples
from etude_studies.method_comparison import compare
from etude_studies.real_logs import EXAMPLES
from etude_studies.truth_wrong import wrongs
from etude_studies.world import World

SIMULATED = ("arm4", "arm4_rough", "mobile_arm", "quadrotor", "quadrotor_rough", "pelican")
RECORDED: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "ur10": ("ur10/ur10_exciting.csv", {}),
    "tx40": ("tx40/tx40_exciting.csv", {}),
    "tiago": ("tiago/tiago_exciting.csv", {}),
    "crazyflie": ("crazyflie/log15_roll_pitch.csv", {"altitude": False, "body_velocity": False}),
}
"""File, and keys of [data] that the log asks for."""
SECONDS = (3.0, 10.0, 30.0)
"""Of the training log; longer ones than a log has are its whole."""
PERCENT = (20.0, 10.0)
TRAINED = 0.7
"""Of a recorded log; what follows a second later is the test."""
TRAPS = ("sign", "unsigned", "turns", "held")
TRAPPED = ("arm4", "ur10")
RIDGE, TINY = 0.1, 1e-12
KNOWN = Path(str(resources.files("etude_studies"))) / "robot_time_entries"
"""Entries that come with the package."""
LINEAR, ETUDE = "etude_studies.robot_time:linear", "etude_studies.robot_time:etude"


@dataclass(frozen=True, eq=False)
class Lesson:
    """What a method may learn from.

    Attributes:
        robot: its name. world: its description, limits and channels.
        log: states and "command" (n, J) as they were recorded.
    """

    robot: str
    world: World
    log: Log

    @property
    def samples(self) -> Samples:
        """As a campaign cleans, filters and thins it."""
        return self.world.samples(self.log)

    def features(self, log: Log) -> Array:
        """(n, D) what Étude's own models look at, of the log of `samples` or of a question."""
        return self.world.inputs(self.world.config.model).of_log(log)


Predictor = Callable[[Log], Array]
Entry = Callable[[Lesson], Predictor | None]


class EntryResult(msgspec.Struct, frozen=True):
    """The result file of an entry.

    Attributes:
        entry: "module:function". seed: of the simulated motions. cpu_s: of all lessons.
        errors: robot -> seconds of the lesson -> root of the mean squared error over the command's spread, %,
            mean over the commands; None: refused.
        data: robot -> SHA-256 of the test's commands. traps: "robot trap" -> whether it was refused.
    """

    entry: str
    seed: int
    cpu_s: float
    errors: dict[str, dict[str, float | None]]
    data: dict[str, str]
    traps: dict[str, bool]

    def until(self, robot: str, percent: float) -> float:
        """Least seconds from which on the error is at most so much; NaN: not reached, or not tried."""
        tried = self.errors.get(robot, {})
        errors = [(float(s), math.inf if e is None else e) for s, e in tried.items()]
        above = [s for s, error in errors if not error <= percent]
        return min((s for s, _ in errors if s > max(above, default=0.0)), default=math.nan)

    @property
    def last(self) -> dict[str, float]:
        """The error of the longest lesson, by robot; NaN: refused."""
        ends = {robot: list(by.values())[-1] for robot, by in self.errors.items()}
        return {robot: math.nan if error is None else error for robot, error in ends.items()}


def run(
    *, json: bool = False, seed: int = 0, seeds: int = 1, folder: Path | None = None, method: str = ""
) -> list[EntryResult]:
    """Scores an entry (the two that come along if none is named), and writes the leaderboard.

    Args:
        json: print the result files' contents. seed: of the motions. seeds: not used: robots are the pairs.
        folder: of result files and `leaderboard.html`. method: "module:function".
    """
    del seeds
    folder = folder or Path("results/robot_time")
    folder.mkdir(parents=True, exist_ok=True)
    results = []
    for name in (method,) if method else (LINEAR, ETUDE):
        with threads_for(0):
            results.append(scored(name, entry_of(name), seed))
        write_atomic(folder / f"{name.replace(':', '.')}.json", msgspec.json.encode(results[-1]))
    board = entries(KNOWN, folder)
    write_atomic(folder / "leaderboard.html", leaderboard(board).encode("utf-8"))
    print(msgspec.json.encode(results).decode() if json else _text(board, folder))  # noqa: T201
    return results


def entry_of(name: str) -> Entry:
    """The function of a name. UsageError: it is none."""
    entry: Any = plugins.named_in_full(name) if plugins.FULL_NAME.fullmatch(name) else None
    if not callable(entry):
        step = "Name a function of one lesson, such as my_entry:learn."
        raise UsageError(f"{name!r} is no module:function", where="--method", next_step=step)
    return entry  # type: ignore[no-any-return]


def scored(name: str, entry: Entry, seed: int) -> EntryResult:
    """Every robot with every number of seconds, and every trap."""
    errors: dict[str, dict[str, float | None]] = {}
    data, began = {}, time.process_time()
    for robot in (*SIMULATED, *RECORDED):
        world, taught, test = task(robot, seed)
        data[robot] = hashlib.sha256(np.round(test.command, 6).tobytes()).hexdigest()
        errors[robot] = {
            f"{seconds:g}": _error(entry, Lesson(robot, world, _first(taught, seconds)), test, robot)
            for seconds in SECONDS
        }
    traps = {
        f"{robot} {trap}": entry(Lesson(robot, task(robot, seed)[0], log)) is None
        for robot in TRAPPED
        for trap, log in wrong_logs(robot, seed)
    }
    return EntryResult(name, seed, round(time.process_time() - began, 1), errors, data, traps)


@cache
def task(robot: str, seed: int) -> tuple[World, Log, Samples]:
    """The robot, the log to learn from, and the test, filtered as a campaign does."""
    if robot in RECORDED:
        file, keys = RECORDED[robot]
        path = EXAMPLES / file
        world = World.of(path.with_name(f"{path.parent.name}.toml"))
        world = replace(world, config=replace(world.config, data=replace(world.config.data, **keys)))
        log = world.read(path)
        place = log.t[0] + TRAINED * (log.t[-1] - log.t[0])
        return world, log.take(log.t < place), world.samples(log.take(log.t > place + 1.0))
    world = World.of(robot)
    taught, tested = (_run(world, np.random.default_rng([seed, place])) for place in (0, 1))
    return world, taught, world.samples(tested)


def _run(world: World, rng: np.random.Generator) -> Log:
    """A random motion under feedback alone, as a recorder of the robot would have it."""
    log = world.robot.run(world.motion(rng), None, rng)
    asides = [name for name, c in log.channels.items() if c.role in ("plan", "truth")]
    return log.without(*asides, "command_ff", "command_fb")


def wrong_logs(robot: str, seed: int) -> Iterator[tuple[str, Log]]:
    """The traps: the robot's log with one thing wrong, the first of each kind."""
    world, log, _ = task(robot, seed)
    path = world.kind.path
    motion, left = seen(log, log.channels[path]), list(TRAPS)
    for wrong in wrongs(log, path, motion.moves if motion else np.zeros(1, dtype=np.bool_)):
        if wrong.error in left:
            left.remove(wrong.error)
            yield wrong.error, wrong.made(log)


def _first(log: Log, seconds: float) -> Log:
    return log.take(log.t <= log.t[0] + seconds)


def _error(entry: Entry, lesson: Lesson, test: Samples, robot: str) -> float | None:
    """%, where the joints move; None: refused."""
    predict = entry(lesson)
    if predict is None:
        return None
    predicted = np.asarray(predict(test.log.without("command")), dtype=float)
    if predicted.shape != test.command.shape:
        step = f"Return an array of shape {test.command.shape}, a row for each state."
        raise DataError(f"the entry returned shape {predicted.shape}", where=robot, next_step=step)
    use = test.usable & test.moving
    wrong = np.where(use, predicted - test.command, np.nan)
    spread = np.nanstd(np.where(use, test.command, np.nan), axis=0)
    return round(float(100.0 * np.nanmean(np.sqrt(np.nanmean(wrong**2, axis=0)) / spread)), 3)


def linear(lesson: Lesson) -> Predictor:
    """Ridge regression on standardised features, held within the command's limits: it refuses nothing."""
    samples = lesson.samples
    X, y = lesson.features(samples.log), samples.command
    centre, scale = X.mean(axis=0), X.std(axis=0) + TINY
    Z, mean = (X - centre) / scale, y.mean(axis=0)
    weights = np.linalg.solve(Z.T @ Z + RIDGE * len(Z) * np.eye(Z.shape[1]), Z.T @ (y - mean))
    low, high = lesson.world.command_limits

    def predict(states: Log) -> Array:
        return np.asarray(np.clip((lesson.features(states) - centre) / scale @ weights + mean, low, high))

    return predict


def etude(lesson: Lesson) -> Predictor | None:
    """Étude's default: its truth tests refuse, its ladder learns what it can."""
    from etude_studies.bench_truth import OF_NUMBERS, findings

    checks = findings(lesson.world, replace(lesson.log, repairs=()))
    if any(f.flag or f.light == "red" or f.check in OF_NUMBERS for f in checks):
        return None
    try:
        rng = np.random.default_rng(0)
        return lesson.world.learned(lesson.samples, lesson.world.config.model, rng).model.mean
    except EtudeError:  # too few seconds: an axis has not moved yet
        return None


def entries(*folders: Path) -> list[EntryResult]:
    """All result files; of an entry that is in several folders the last. DataError: a file is none."""
    results = {}
    for path in (path for folder in folders for path in sorted(folder.glob("*.json"))):
        try:
            result = msgspec.json.decode(path.read_bytes(), type=EntryResult)
        except msgspec.DecodeError as error:
            step = "Delete it, and score the entry again."
            raise DataError(
                f"this is no result of an entry: {error}", where=str(path), next_step=step
            ) from error
        results[result.entry, result.seed] = result
    return sorted(results.values(), key=lambda result: np.nanmean(list(result.last.values())))


HEADER = (
    "entry",
    *(f"robots at {p:g} %" for p in PERCENT),
    "error, %",
    "over linear",
    "word",
    "traps refused",
    "right logs refused",
    "CPU s",
)


def rows(board: list[EntryResult]) -> list[list[str]]:
    """A line for each entry: robots that reach each error, the mean error, the word, traps refused."""
    base = {result.seed: result for result in board if result.entry == LINEAR}
    return [_row(result, base.get(result.seed)) for result in board]


def _row(result: EntryResult, base: EntryResult | None) -> list[str]:
    reached = [
        f"{sum(math.isfinite(result.until(r, p)) for r in result.errors)}/{len(result.errors)}"
        for p in PERCENT
    ]
    comparison = ["", ""]
    if base is not None and base is not result and base.data == result.data:
        pair = dict(enumerate(result.last.values())), dict(enumerate(base.last.values()))
        compared = compare({"": pair})[""]
        comparison = ["" if compared.estimate is None else f"{compared.estimate:.3g}", compared.word]
    elif base is not None and base is not result:
        comparison = ["", "other data"]
    traps = f"{sum(result.traps.values())}/{len(result.traps)}"
    lessons = [error for by in result.errors.values() for error in by.values()]
    right = f"{lessons.count(None)}/{len(lessons)}"
    mean = f"{np.nanmean(list(result.last.values())):.3g}"
    return [
        f"{result.entry} (seed {result.seed})",
        *reached,
        mean,
        *comparison,
        traps,
        right,
        f"{result.cpu_s:g}",
    ]


def leaderboard(board: list[EntryResult]) -> Html:
    """The page: a line for each entry, and below seconds until each error by robot."""
    style = resources.files("etude.report").joinpath("report.css").read_text(encoding="utf-8")
    head = ["entry", *dict.fromkeys(robot for result in board for robot in result.errors)]
    parts: list[object] = [
        element("h1", "Robot time to an error"),
        paragraph(_explanation()),
        table(HEADER, rows(board)),
    ]
    for percent in PERCENT:
        parts.append(element("h2", f"Seconds to {percent:g} %"))
        lines = [[one.entry, *(_seconds(one.until(robot, percent)) for robot in head[1:])] for one in board]
        parts.append(table(head, lines))
    return document("Robot time to an error", element("style", Html(style)), element("main", *parts))


def _explanation() -> str:
    return (
        "Root mean squared error of the predicted command over its spread, mean over the commands, on a test "
        f"that the entry never saw. It learned the first {', '.join(f'{s:g}' for s in SECONDS)} s of a log. "
        "Robots are paired; the word says whether the error is below that of linear regression. Traps are "
        "wrong logs; right ones are refused where nothing is returned."
    )


def _seconds(value: float) -> str:
    return f"{value:g}" if math.isfinite(value) else "not reached"


def _text(board: list[EntryResult], folder: Path) -> str:
    lines = ["  ".join(map(str, HEADER)), *("  ".join(row) for row in rows(board))]
    return "\n".join([*lines, f"The page: {folder / 'leaderboard.html'}"])
