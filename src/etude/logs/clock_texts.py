"""Times that are written as text: dates, durations, and numbers with their unit behind."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from etude.contracts import Array

MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_CLOCK = r"(?P<clock>\d\d:\d\d:\d\d(?:\.\d{1,9})?)"
ISO = re.compile(rf"(?P<y>\d{{4}})[-/](?P<m>\d\d)[-/](?P<d>\d\d)[T ]{_CLOCK} ?(?:Z|UTC|[+-]\d\d:?\d\d)?")
MATLAB = re.compile(rf"(?P<d>\d\d)-(?P<m>[A-Za-z]{{3}})-(?P<y>\d{{4}}) {_CLOCK}")
DURATION = re.compile(r"(?:(\d+) days?,? )?(\d+):(\d\d):(\d\d(?:\.\d+)?)")
MEASURED = re.compile(r"(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?) (sec|seconds|s|ms|min|hr)")
SECONDS = {"sec": 1.0, "seconds": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0, "hr": 3600.0}
GIGA = 1e9


def nanoseconds(cells: Sequence[str | None]) -> Array | None:
    """(T,) ns of cells that are times, a time zone left out; NaN of a cell that is none. None if the first
    cell that says something is no time.

    Dates count from 1970, durations (`0 days 00:00:01.5`, `00:00:01.5`, `1.5 sec`) from zero, as pandas and
    MATLAB write both.
    """
    first = next((cell for cell in cells[:100] if cell), "")
    form = next(((pattern, read) for pattern, read in FORMS if pattern.fullmatch(first)), None)
    if form is None:
        return None
    pattern, read = form
    return np.array([_read(pattern.fullmatch(cell or ""), read) for cell in cells], dtype=np.float64)


def _read(found: re.Match[str] | None, read: Callable[[re.Match[str]], float]) -> float:
    if found is None:
        return float("nan")
    try:
        return read(found)
    except ValueError:  # the 31st of June
        return float("nan")


def _date(found: re.Match[str]) -> float:
    month = found["m"]
    number = int(month) if month.isdigit() else MONTHS.index(month.lower()) + 1
    text = f"{found['y']}-{number:02d}-{found['d']}T{found['clock']}"
    return float(np.datetime64(text, "ns").astype(np.int64))


def _duration(found: re.Match[str]) -> float:
    days, hours, minutes = (int(part or 0) for part in found.groups()[:3])
    return GIGA * (((24.0 * days + hours) * 60.0 + minutes) * 60.0 + float(found[4]))


def _measured(found: re.Match[str]) -> float:
    return GIGA * SECONDS[found[2]] * float(found[1])


FORMS = ((ISO, _date), (MATLAB, _date), (DURATION, _duration), (MEASURED, _measured))
