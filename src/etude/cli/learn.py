"""etude learn"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from etude.cli.outcome import Common, Outcome, Say, code_of, opened
from etude.errors import EtudeError, UsageError

GROUP = "etude.engines"


@dataclass(frozen=True)
class LearnedFolder:
    """Result for one campaign.

    Attributes:
        folder: its path. structure: in use now. problem: why it could not be learned; "" if it was.
        logs: numbers of the logs that the training ended with; () if nothing was told.
    """

    folder: str
    logs: tuple[int, ...] = ()
    structure: str = ""
    problem: str = ""

    @property
    def sentence(self) -> str:
        """For a table."""
        if self.problem:
            return f"not learned: {self.problem}"
        return f"learned, {self.structure}" if self.logs else "no log was ingested"


@dataclass(frozen=True, kw_only=True)
class Learn(Common):
    """Train the models of campaigns anew from all logs: after an update of Étude, or of campaign.toml.

    Promoted models stay in use. A campaign that cannot be trained does not stop the others; the exit code is
    then 3.
    """

    folders: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER [FOLDER ...]")
    ] = ()
    """Campaign folders. The workers of a cluster need the same paths."""
    workers: int | None = None
    """Number of processes on this machine, each with one campaign. Default: one campaign after the other."""
    cluster: Annotated[str, tyro.conf.arg(metavar="NAME")] = ""
    """tcp://host:port of a Dask scheduler, to train there."""

    def run(self, say: Say) -> Outcome:
        if not self.folders:
            raise UsageError("there is no campaign to learn", next_step="Name one or more folders.")
        paths = [str(folder.absolute()) for folder in self.folders]
        for folder in self.folders:
            opened(folder)  # every folder is checked before anything is learned
        outcomes = {}
        for one in self._learn(paths, say):
            outcomes[one.folder] = one
            say(f"{len(outcomes)} of {len(paths)}: {one.folder}: {one.sentence.rstrip('.')}.")
        rows = [outcomes[path] for path in paths]
        wide = max(len(path) for path in paths)
        lines = [f"{one.folder.ljust(wide)}  {one.sentence}" for one in rows]
        data = {"campaigns": [asdict(one) for one in rows]}
        return Outcome(
            "\n".join(lines), data, code_of(changed=False, refused=any(one.problem for one in rows))
        )

    def _learn(self, paths: Sequence[str], say: Say) -> Iterator[LearnedFolder]:
        if self.workers is None and not self.cluster:
            yield from map(learn_campaign, paths)
            return
        with _engine()(self.workers, self.cluster, None, say) as engine:
            futures = {engine.submit(learn_campaign, path): path for path in paths}
            for done in as_completed(futures):
                try:
                    yield done.result()
                except EtudeError as problem:  # of the engine: its process died, or the cluster went away
                    yield LearnedFolder(futures[done], problem=str(problem))


def learn_campaign(path: str) -> LearnedFolder:
    """Learns one campaign in this process; returns its errors instead of raising them."""
    from etude.campaign.training import learn_again

    try:
        campaign = opened(Path(path))
        numbers = learn_again(campaign)
        newest = campaign.state().newest
    except EtudeError as problem:
        return LearnedFolder(path, problem=str(problem))
    return LearnedFolder(path, tuple(numbers), newest.chosen if newest else "")


def _engine() -> Callable[..., Executor]:
    """Executor of processes or of a cluster. UsageError: its package is not installed."""
    from etude import plugins
    from etude.cli.study import require_studies

    require_studies("learn")
    engine: Callable[..., Executor] = plugins.load(GROUP, plugins.names(GROUP)[0])
    return engine
