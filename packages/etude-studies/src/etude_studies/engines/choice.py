"""Choice of the engine by the options of a command."""

from __future__ import annotations

import re
from collections.abc import Callable

from etude.errors import UsageError
from etude_studies.engines.cluster import Cluster, connect
from etude_studies.engines.workers import Workers


def open_engine(
    workers: int | None = None,
    cluster: str = "",
    limit_s: float | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Workers | Cluster:
    """The engine, to be used as a context manager.

    Args:
        workers: processes of this machine; None for one a core.
        cluster: "tcp://host:port" of a Dask scheduler, instead of processes of this machine.
        limit_s: wall time that one run may take; processes of this machine only.
        tell: is told what is strange about the cluster.

    Raises:
        UsageError: options that contradict each other or make no sense, or a cluster that does not answer.
    """
    if workers is not None and workers < 1:
        raise UsageError(f"{workers} workers do nothing", where="--workers", next_step="Give 1 or more.")
    if limit_s is not None and not limit_s > 0.0:
        raise UsageError(f"a limit of {limit_s:g} s lets nothing run", next_step="Give a longer one.")
    if not cluster:
        return Workers(workers, limit_s)
    if workers is not None or limit_s is not None:
        option = "a number of workers" if workers is not None else "a time limit for each run"
        raise UsageError(
            f"{option} is for processes of this machine, not for a cluster",
            where=f"--cluster {cluster}",
            next_step="Leave one of them out; workers are started with the cluster.",
        )
    return connect(cluster, tell)


def shard(text: str) -> tuple[int, int]:
    """(i, n) of "i/n", 1 <= i <= n. UsageError: it is no such thing."""
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    index, all_ = (int(part) for part in match.groups()) if match else (0, 0)
    if not 1 <= index <= all_:
        raise UsageError(
            f"{text!r} is no shard", where="--shard", next_step="Write i/n with 1 <= i <= n, such as 3/8."
        )
    return index, all_
