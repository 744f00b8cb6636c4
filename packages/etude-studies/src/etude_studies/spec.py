"""The specification of a run, frozen and hashed, and the pure function that carries it out in memory."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from etude import plugins
from etude.errors import UsageError
from etude.threads import threads_for
from etude_studies.measured import measured_table

if TYPE_CHECKING:
    import polars as pl

HASH_LENGTH = 20


@dataclass(frozen=True, init=False)
class Spec:
    """One run: everything that its result depends on, but for the code.

    Attributes:
        function: "module:attribute", called with (settings, seed, needs).
        settings_text: canonical JSON of the settings.
        seed: of all random numbers of the run.
        needs: runs whose results it is given.
    """

    function: str
    settings_text: str
    seed: int
    needs: tuple[Spec, ...]

    def __init__(
        self, function: str, settings: Mapping[str, Any], seed: int, needs: Sequence[Spec] = ()
    ) -> None:
        """UsageError: the function is not "module:attribute", or the settings have no JSON."""
        if not plugins.FULL_NAME.fullmatch(function):
            raise UsageError(f"{function!r} is no module:attribute", next_step="Name a function of a module.")
        object.__setattr__(self, "function", function)
        object.__setattr__(self, "settings_text", _json(_plain(settings, "settings")))
        object.__setattr__(self, "seed", int(seed))
        object.__setattr__(self, "needs", tuple(needs))

    @property
    def settings(self) -> dict[str, Any]:
        """A copy of the settings, as JSON gives them back: tuples are lists."""
        settings: dict[str, Any] = json.loads(self.settings_text)
        return settings

    def canonical(self) -> str:
        """The run as JSON, those it needs within it: sorted keys, no blanks, floats by repr."""
        return _json(_described(self))

    @cached_property
    def hash(self) -> str:
        """The first 20 hexadecimal digits of the SHA-256 of the canonical form; the result's name."""
        return hashlib.sha256(self.canonical().encode()).hexdigest()[:HASH_LENGTH]

    @property
    def label(self) -> str:
        """A few words for people: the run's name, if its settings have one, and the seed."""
        name = self.settings.get("run", self.function.partition(":")[2])
        return f"{name} seed {self.seed}"


def spec_of(canonical: str) -> Spec:
    """The spec of a canonical form. UsageError: it is none."""
    try:
        return _spec(json.loads(canonical))
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(
            f"this describes no run: {error}", where=canonical[:80], next_step="Take it from a result's file."
        ) from error


def run_one(spec: Spec, needs: Mapping[str, pl.DataFrame]) -> pl.DataFrame:
    """Carries out one run: pure and in memory, with one BLAS and one Numba thread.

    Args:
        spec: the run.
        needs: the tables of `spec.needs` by hash; the function gets them in the order of `spec.needs`.

    Returns:
        What the function measured, as `results.measured_table` has it. A stage that others share may return
        a table of its own columns instead, which is kept as it is.

    Raises:
        UsageError: the function cannot be loaded, or a needed table is not there.
        DataError: it returned something else than measurements.
    """
    import polars as pl

    function: Callable[..., Any] = plugins.load("etude.studies", spec.function)
    missing = [needed.label for needed in spec.needs if needed.hash not in needs]
    if missing:
        raise UsageError(f"{spec.label} needs the result of {missing[0]}", next_step="Run that first.")
    tables = {needed.hash: needs[needed.hash] for needed in spec.needs}
    with threads_for(0), _one_numba_thread():
        result = function(spec.settings, spec.seed, tables)
    return result if isinstance(result, pl.DataFrame) else measured_table(result, spec.function)


@contextmanager
def _one_numba_thread() -> Iterator[None]:
    """Where the function's module has loaded Numba; it is not loaded for this."""
    numba = sys.modules.get("numba")
    if numba is None:
        yield
        return
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _described(spec: Spec) -> dict[str, Any]:
    needs = [_described(needed) for needed in spec.needs]
    return {"function": spec.function, "needs": needs, "seed": spec.seed, "settings": spec.settings}


def _spec(description: Mapping[str, Any]) -> Spec:
    needs = [_spec(needed) for needed in description["needs"]]
    return Spec(description["function"], description["settings"], description["seed"], needs)


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _plain(value: Any, where: str) -> Any:
    """The same in what JSON keeps unchanged. UsageError: there is something else in it."""
    if isinstance(value, Mapping):
        strange = [key for key in value if not isinstance(key, str)]
        if strange:
            raise UsageError(
                f"the key {strange[0]!r} is no text", where=where, next_step="Name it by a text."
            )
        return {key: _plain(part, f"{where}.{key}") for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part, f"{where}[{i}]") for i, part in enumerate(value)]
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float) and math.isfinite(value):
        return float(value)
    raise UsageError(
        f"{value!r} cannot be part of a run's settings",
        where=where,
        next_step="Use texts, finite numbers, true and false, lists and tables of them.",
    )
