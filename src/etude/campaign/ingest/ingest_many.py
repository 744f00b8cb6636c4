"""Tells one log or many: each is taken in or refused by itself, and all are learned in one training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack, overload

from etude.campaign.ingest.ingest_result import How, Told
from etude.campaign.ingest.tell import finished, newest_warnings, take
from etude.campaign.ingest.tell import tell as tell_one
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.training import Learner
from etude.codes import Notice
from etude.errors import DataError, UsageError


@dataclass(frozen=True)
class IngestedFile:
    """What became of one of several files: `told`, or the error for which it was refused."""

    path: Path
    ingested: Told | None
    refused: DataError | None = None

    @property
    def sentence(self) -> str:
        """For a table."""
        if self.ingested is None:
            assert self.refused is not None
            return f"refused: {self.refused.fact}"
        if self.ingested.run:
            return f"run {self.ingested.run} the feedforward of {self.ingested.number}, not learned"
        first = (
            "told before" if self.ingested.repeated else "foreign" if self.ingested.foreign else "answered"
        )
        number = (
            f"{first} {self.ingested.number}"
            if first == "answered"
            else f"{first}, as {self.ingested.number}"
        )
        excluded = "; set aside" if self.ingested.excluded else ""
        return number + ("; waits for an answer" if self.ingested.awaits_answer else excluded)


@dataclass(frozen=True)
class IngestedMany:
    """What became of several files.

    Attributes:
        files: in the order in which they were given, each file once.
        learned: numbers of the logs that were learned now, in one training.
        warnings: what that training has to say.
    """

    files: tuple[IngestedFile, ...]
    learned: tuple[int, ...]
    warnings: tuple[Notice, ...]

    @property
    def refused(self) -> tuple[IngestedFile, ...]:
        return tuple(file for file in self.files if file.ingested is None)


@overload
def tell(  # type: ignore[overload-overlap]  # a str is a Sequence[str], and means one file
    campaign: Campaign,
    path: str | Path,
    *,
    number: int | None = None,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> Told: ...


@overload
def tell(
    campaign: Campaign,
    path: Sequence[str | Path],
    *,
    number: int | None = None,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> IngestedMany: ...


def tell(
    campaign: Campaign,
    path: str | Path | Sequence[str | Path],
    *,
    number: int | None = None,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> Told | IngestedMany:
    """Stores a log, or several, and learns them: `campaign.tell.tell` and `tell_many`, by what is given."""
    if isinstance(path, str | Path):
        return tell_one(
            campaign,
            Path(path),
            number=number,
            changed=changed,
            learner=learner,
            say=say,
            **how,
        )
    if number is not None:
        raise UsageError("a number belongs to one log", next_step="Tell that log by itself.")
    paths = [Path(one) for one in path]
    return tell_many(campaign, paths, changed=changed, learner=learner, say=say, **how)


def tell_many(
    campaign: Campaign,
    paths: Sequence[Path],
    *,
    changed: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
    **how: Unpack[How],
) -> IngestedMany:
    """Stores every log that can be used, then learns all of them at once.

    Files are taken in the order of their names, and what fits no open proposal is looked at again once others
    have answered theirs, so the order in which they are given changes nothing. Each is committed by itself:
    an interrupted run is finished by the same command. Without a file, `changed` answers for the logs that
    wait.

    Raises:
        UsageError: a proposal's file is missing or was changed, or `changed` has nothing to speak of.
        DataError, NumericalError: all logs together cannot be learned; they are stored and wait.
    """
    with campaign.writing():
        found = _taken(campaign, paths, how, say)
        places = [i for i, file in enumerate(found) if file.ingested is not None]
        ingested = [file.ingested for file in found if file.ingested is not None]
        before = {r.number for r in campaign.state().learned}
        for place, one in zip(places, finished(campaign, ingested, changed, learner, say), strict=True):
            found[place] = replace(found[place], ingested=one)
        state = campaign.state()
    learned = tuple(r.number for r in state.learned if r.number not in before)
    return IngestedMany(tuple(found), learned, newest_warnings(campaign, state))


def _taken(campaign: Campaign, paths: Sequence[Path], how: How, say: Say) -> list[IngestedFile]:
    """Every file, stored or refused, in the order in which they were given."""
    found: dict[Path, IngestedFile] = {}
    left = sorted(set(paths), key=lambda path: (path.name, str(path)))
    while left:
        open_before, refused = len(campaign.state().proposals), []
        for path in left:
            found[path] = _one(campaign, path, how)
            say(f"{path.name}: {found[path].sentence}.")
            refused += [path] if found[path].ingested is None else []
        # what fitted none of several open proposals may answer none at all
        left = refused if len(campaign.state().proposals) < open_before else []
    return [found[path] for path in dict.fromkeys(paths)]


def _one(campaign: Campaign, path: Path, how: How) -> IngestedFile:
    try:
        return IngestedFile(path, take(campaign, path, **how))
    except DataError as error:
        return IngestedFile(path, None, error)
