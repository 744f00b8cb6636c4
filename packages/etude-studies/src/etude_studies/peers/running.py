"""A peer that is ready to evaluate: in this process, or in the interpreter of another environment."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any

import numpy as np

from etude.errors import EtudeError
from etude.types import Array
from etude_studies.peers import worker
from etude_studies.peers.catalogue import Peer

Timed = tuple[float, Array, float]

POOLS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Environment variables that give a process of its own one thread."""


class PeerUnavailable(EtudeError):
    """A peer that cannot be imported, or that failed on the way."""


@dataclass(frozen=True)
class Running:
    """A peer that holds its data.

    Attributes:
        described: its name and version, and what to know about the figure.
        evaluate: parameters (P,) -> negative log marginal likelihood, gradient (P,), seconds; raises
            PeerUnavailable.
    """

    described: str
    evaluate: Callable[[Array], Timed]


@contextmanager
def started(peer: Peer, X: Array, y: Array, pythons: Sequence[Path] = ()) -> Iterator[Running]:
    """The peer on X (n, D) and y (n,): in this process if it can be imported, else by the first of `pythons`.

    Raises:
        PeerUnavailable: with the reason of each place.
    """
    reasons = []
    with ExitStack() as stack:
        for python in (None, *pythons):
            place = here(peer, X, y) if python is None else in_own_process(python, peer, X, y)
            try:
                running = stack.enter_context(place)
            except PeerUnavailable as reason:
                reasons.append(reason.fact)
            else:
                yield running
                return
    raise PeerUnavailable("; ".join(reasons))


@contextmanager
def here(peer: Peer, X: Array, y: Array) -> Iterator[Running]:
    """The peer in this process; PeerUnavailable if its library is not here or does not work."""
    try:
        module = worker.loaded(str(peer.file))
        objective = module.objective(X, y)
        described = _described(peer, version(peer.distribution), module.NOTE)
    except Exception as error:  # a library made for another NumPy may fail in any way
        raise PeerUnavailable(f"here: {_reason(error)}") from error

    def evaluate(parameters: Array) -> Timed:
        try:
            return worker.timed(objective, parameters)
        except Exception as error:
            raise PeerUnavailable(f"here: {_reason(error)}") from error

    yield Running(described, evaluate)


@contextmanager
def in_own_process(python: Path, peer: Peer, X: Array, y: Array) -> Iterator[Running]:
    """The peer in another environment's interpreter, one thread; PeerUnavailable if it cannot be there."""
    with tempfile.TemporaryFile("w+") as complaints, _process(python, complaints) as process:

        def ask(request: dict[str, Any]) -> dict[str, Any]:
            answer = _answer(process, request)
            if "error" in answer:
                raise PeerUnavailable(f"{python}: {answer['error'] or _last_line(complaints)}")
            return answer

        def evaluate(parameters: Array) -> Timed:
            answer = ask({"parameters": parameters.tolist()})
            return answer["value"], np.array(answer["gradient"]), answer["seconds"]

        description = ask(
            {
                "file": str(peer.file),
                "distribution": peer.distribution,
                "X": X.tolist(),
                "y": y.tolist(),
            }
        )
        yield Running(_described(peer, description["version"], description["note"], "own process"), evaluate)


@contextmanager
def _process(python: Path, complaints: IO[str]) -> Iterator[subprocess.Popen[str]]:
    """The worker, which ends with the block."""
    environment = os.environ | dict.fromkeys(POOLS, "1")
    environment.pop("PYTHONPATH", None)  # this environment's libraries are not the other's
    try:
        process = subprocess.Popen(
            [str(python), str(worker.__file__)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=complaints,
            text=True,
            env=environment,
        )
    except OSError as error:
        raise PeerUnavailable(f"{python}: {error.strerror}") from error
    with process:
        try:
            yield process
        finally:
            process.kill()
            assert process.stdin is not None
            with suppress(BrokenPipeError):  # it may have died with a request unread
                process.stdin.close()


def _answer(process: subprocess.Popen[str], request: dict[str, Any]) -> dict[str, Any]:
    """What the worker answers; an empty error if it has died or says something else."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(json.dumps(request) + "\n")
        process.stdin.flush()
        answer = json.loads(process.stdout.readline())
    except (OSError, ValueError):
        return {"error": ""}
    return answer if isinstance(answer, dict) else {"error": ""}


def _last_line(complaints: IO[str]) -> str:
    complaints.seek(0)
    lines = complaints.read().strip().splitlines()
    return f"ended without an answer{': ' + lines[-1] if lines else ''}"


def _described(peer: Peer, number: str, *notes: str) -> str:
    return ", ".join(part for part in (f"{peer.title} {number}", *notes) if part)


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
