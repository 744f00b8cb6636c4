"""The function that a worker calls for one run: it returns a result or a sentence, and never raises."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from etude.errors import EtudeError
from etude_studies.made import Made, made_by
from etude_studies.spec import Spec, run_one

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class Done:
    """A result, where it comes from, and what is odd about it ("" if nothing)."""

    table: pl.DataFrame
    made: Made
    note: str = ""


@dataclass(frozen=True)
class Failed:
    """Why there is no result, one sentence."""

    sentence: str


def carry_out(spec: Spec, needs: Mapping[str, pl.DataFrame]) -> Done | Failed:
    """Carries out a run; whatever its function raises becomes a sentence that any engine can carry back."""
    try:
        table, made = made_by(partial(run_one, spec, needs))
    except EtudeError as error:
        place = f" [{error.where}]" if error.where else ""
        return Failed(f"{error.fact}{place}")
    except (Exception, SystemExit) as error:
        return Failed(in_words(error))
    return Done(table, made, not_finite(table))


def not_finite(table: pl.DataFrame) -> str:
    """Says how many measured values are NaN or infinite, and which is the first; "" if none is."""
    import polars as pl

    if "measure" not in table.columns:
        return ""
    odd = table.filter(~pl.col("value").is_finite())
    if odd.is_empty():
        return ""
    k, test, model, part, measure, _ = odd.row(0)
    named = " ".join(word for word in (measure, part, test, model) if word)
    return f"{len(odd)} of {len(table)} values are not finite, the first is {named} at {k}"


def in_words(error: BaseException) -> str:
    """The exception, and the place in the innermost function that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" [{frames[-1].filename}, line {frames[-1].lineno}]" if frames else ""
    first = (str(error).strip().splitlines() or [""])[0][:300]
    return f"{type(error).__name__}: {first}{place}" if first else f"{type(error).__name__}{place}"
