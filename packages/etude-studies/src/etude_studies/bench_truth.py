"""`etude bench truth`: which wrong logs the truth tests tell, and which right ones they suspect.

Every real log at hand and 200 simulated ones are put wrong by mutation and pass what `etude tell` asks. A
wrong joint (sign, jump), pair of joints (swapped) or log (the others) ends as told right, told wrong (another
cause), refused (nothing was told, but ranges forbid it), missed, or "cannot tell". Finished logs are files in
results/truth and are not run again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import msgspec
import numpy as np

from etude.campaign import Answers, LogQuestions, judged_commands
from etude.errors import EtudeError
from etude.logs import Doubt, Mendable, clean_log, judge_motion, judge_numbers, seen
from etude.storage import write_atomic
from etude.types import Finding, Log
from etude_studies.engines.each import each
from etude_studies.rows import Row, rows_json, table
from etude_studies.truth_logs import Source, as_recorded, load, real_sources, simulated_sources
from etude_studies.truth_wrong import Wrong, wrongs
from etude_studies.world import World

FOLDER = Path("results/truth")
SIMULATED, QUICK, WORKERS = 200, 40, 2
ENDS = ("right", "wrong", "refused", "missed", "cannot tell")
REFUSED = "refused"
CUT = ("ground", "jump")
"""Checks that ask nothing: what they find is cut, and said."""
OF_NUMBERS = ("held", "held_commands", "unsigned", "off", "copied", "turns", "overflow", "lost")
OF_ODDS = ("sign", "swapped")
"""Of simulated logs `etude bench odds` counts these, over more arms."""
ERRORS = ("sign", "x2", "x60", "reversed", "degrees", "swapped", "ground", "jump", *OF_NUMBERS)


class Ended(msgspec.Struct, frozen=True):
    """What became of one log.

    Attributes:
        counts: error -> end -> how many.
        flagged: checks that suspect the right log, with their sentences.
        sentences: one of each error that was told.
        missing: what was missed or told wrong, for people.
    """

    counts: dict[str, dict[str, int]]
    flagged: dict[str, str]
    sentences: dict[str, str]
    missing: list[str]


def run(*, json: bool = False, seed: int = 0, quick: bool = False, logs: Path | None = None) -> list[Row]:
    """Judges all logs and prints the rows; `quick` with 40 simulated logs instead of 200. `logs` is a folder
    with further recordings (`truth_logs`).
    """
    simulated = simulated_sources(QUICK if quick else SIMULATED, seed)
    sources = [*real_sources(logs), *simulated]
    results = dict(zip(sources, each(partial(kept, folder=FOLDER), sources, WORKERS), strict=True))
    rows = truth_rows(results)
    if json:
        command = "etude bench truth" + " --quick" * quick + " --logs FOLDER" * (logs is not None) + " --json"
        print(rows_json(rows, command))  # noqa: T201
    else:
        table(rows, "truth tests")
    return rows


def kept(source: Source, folder: Path) -> Ended:
    """What became of one log, from its file if it was judged before."""
    path = folder / f"{source.key}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, msgspec.json.encode(judged(source)))
    return msgspec.json.decode(path.read_bytes(), type=Ended)


def judged(source: Source) -> Ended:
    """Judges the right log and every wrong one that is made of it."""
    world, log = load(source)
    log = as_recorded(log)
    right = findings(world, log)
    flagged = {f.check: f.sentence for f in right if f.flag or f.light == "red" or f.check in OF_NUMBERS}
    path = world.kind.path
    motion = seen(log, log.channels[path]) if path in log else None
    moves = np.zeros(1, dtype=np.bool_) if motion is None else motion.moves
    counts: dict[str, Counter[str]] = {}
    sentences: dict[str, str] = {}
    missing = []
    for wrong in wrongs(log, path, moves):
        if wrong.error in OF_ODDS and not source.real:
            continue
        checked = findings(world, wrong.made(log))
        end, sentence = ending(wrong, checked, right)
        counts.setdefault(wrong.error, Counter())[end] += 1
        if end == "right":
            sentences.setdefault(wrong.error, sentence)
        elif end != "cannot tell":
            missing.append(f"{wrong.error} of {wrong.part}: {end}: {sentence}")
    return Ended({error: dict(by_end) for error, by_end in counts.items()}, flagged, sentences, missing)


def findings(world: World, log: Log) -> list[Finding]:
    """All that `tell` asks of a log; a refusal for another reason is a red finding, "refused"."""
    kind, spec = world.kind, world.spec
    expected, channels = kind.expected(spec), kind.channels(spec)
    with np.errstate(all="ignore"):
        numbers = list(judge_numbers(log, expected.limits))
        if numbers:
            return numbers
        motion = list(judge_motion(log, kind.path, channels, expected.limits, expected.rate))
        if any(f.flag for f in motion):
            return motion
        commands = list(judged_commands(kind, spec, log))
        if any(f.flag for f in commands):
            return [*motion, *commands]
        try:
            clean = clean_log(log, channels, expected.limits, {}, LogQuestions(kind, spec, Answers()).motion)
        except EtudeError as error:
            return [*motion, *commands, Finding(REFUSED, "red", error.fact)]
        return [*motion, *commands, *kind.checks(spec, clean)]


def ending(wrong: Wrong, checked: list[Finding], right: list[Finding]) -> tuple[str, str]:
    """Which of ENDS, and the sentence that says so. What the right log shows already is no detection."""
    before = {f.sentence for f in right}
    alerts = [
        f
        for f in checked
        if (f.flag or f.light == "red" or f.check in (*CUT, *OF_NUMBERS)) and f.light != "green"
    ]
    news = [f for f in alerts if f.sentence not in before]
    mine = [f for f in news if _names(wrong, f, right)]
    if mine:
        return "right", mine[0].sentence
    if news:
        return ("refused" if news[0].check == REFUSED else "wrong"), news[0].sentence
    relevant = [f for f in checked if f.check in (wrong.check, *INSTEAD.get(wrong.check, ()))]
    unsure = not relevant or any(f.light == "cannot tell" for f in relevant) or _unsure(wrong, relevant)
    return ("cannot tell" if unsure else "missed"), ""


INSTEAD = {"time": ("velocity",), "direction": ("velocity", "sign")}
"""The checks of which one stands where nothing was found."""


def _unsure(wrong: Wrong, relevant: list[Finding]) -> bool:
    """Whether a green finding leaves this joint out: its sentence names those of which it cannot be told."""
    return wrong.error == "sign" and any("cannot be told" in f.sentence for f in relevant)


def _names(wrong: Wrong, finding: Finding, right: list[Finding]) -> bool:
    """Whether a finding says what was done: no more, and no less."""
    by = finding.by if isinstance(finding, Doubt) else ()
    if wrong.error in OF_NUMBERS:
        return finding.check == wrong.check
    if wrong.error == "sign":
        before = next((f.by for f in right if f.check == "sign" and isinstance(f, Doubt)), (1.0,) * len(by))
        flipped = tuple(-sign if j == wrong.part else sign for j, sign in enumerate(before))
        return finding.check == "sign" and by == flipped
    if wrong.error == "swapped":
        if isinstance(finding, Mendable):
            return finding.check == "swapped" and tuple(int(j) for j in by) == wrong.order
        return _moved(finding.check, by) == _moved("swapped", wrong.order)
    return any(phrase in finding.sentence for phrase in wrong.says)


def _moved(check: str, by: Sequence[float]) -> set[int]:
    """The joints that a question of signs or columns is about."""
    return {i for i, j in enumerate(by) if (j < 0.0 if check == "sign" else int(j) != i)}


def truth_rows(results: dict[Source, Ended]) -> list[Row]:
    """`<set>_<error>_<end>`, of all simulated logs and of each real one, and false alarms."""
    rows = []
    for name, ended_logs in groups(results).items():
        for error in ERRORS:
            counts: Counter[str] = Counter()
            for ended in ended_logs:
                counts.update(ended.counts.get(error, {}))
            total = sum(counts.values())
            rows += [
                Row(f"{name}_{error}_{end.replace(' ', '_')}", counts[end], "1", "of", total)
                for end in ENDS
                if total
            ]
        alarms = sum(len(ended.flagged) for ended in ended_logs)
        rows.append(Row(f"{name}_right_logs_suspected", alarms, "1", "logs", len(ended_logs)))
    return rows


def groups(results: dict[Source, Ended]) -> dict[str, list[Ended]]:
    """Simulated logs by robot and velocities, real ones by name."""
    grouped: dict[str, list[Ended]] = {}
    for source, ended in results.items():
        name = source.key if source.real else source.name.rsplit("_", 1)[0] + source.key[len(source.name) :]
        grouped.setdefault(name, []).append(ended)
    return grouped


def texts(results: Iterable[Ended]) -> dict[str, str]:
    """A sentence of each error that was told."""
    return {error: text for ended in results for error, text in ended.sentences.items()}
