"""Times that are written as text: dates, durations, and numbers with their unit behind."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from etude.types import Array

MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_CLOCK = r"(?P<h>\d\d?):?(?P<min>\d\d):?(?P<s>\d\d(?:[.,:]\d{1,9})?)(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
_ZONE = r" ?(?:Z|UTC|[+-]\d\d:?\d\d)?"
ISO = re.compile(rf"(?P<y>\d{{4}})([-/.]?)(?P<m>\d\d)\2(?P<d>\d\d)[T _]{_CLOCK}{_ZONE}")
MATLAB = re.compile(rf"(?P<d>\d\d)[- ](?P<m>[A-Za-z]{{3}})[- ](?P<y>\d{{4}}) {_CLOCK}{_ZONE}")
DAY_FIRST = re.compile(rf"(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{{4}}),? {_CLOCK}")
# Of 5/6/2024 nobody knows which is the day, and only differences count: the month, unless it is none.
SLASHES = re.compile(rf"(?P<m>\d\d?)/(?P<d>\d\d?)/(?P<y>\d{{4}}),? {_CLOCK}")
DURATION = re.compile(r"(?:(\d+) days?,? )?(\d+):(\d\d):(\d\d(?:[.,:]\d+)?)")
MINUTES = re.compile(r"(\d\d):(\d\d[.,]\d+)")
HALVES = re.compile(r"(?P<h>\d\d?):(?P<min>\d\d):(?P<s>\d\d(?:[.,:]\d+)?) ?(?P<half>[AaPp])\.?[Mm]\.?")
MEASURED = re.compile(r"(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?) (sec|seconds|s|ms|min|hr)")
SECONDS = {"sec": 1.0, "seconds": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0, "hr": 3600.0}
GIGA = 1e9


def nanoseconds(cells: Sequence[str | None]) -> Array | None:
    """(T,) ns of cells that are times, a time zone left out; NaN of a cell that is none. None if the first
    cell that says something is no time.

    Dates count from 1970, durations (`0 days 00:00:01.5`, `00:00:01.5`, `1.5 sec`) from zero, as pandas and
    MATLAB write both; a clock without a date (`12:30:05,250`, `01:30:05.25 PM`, `30:05.250`) is a duration.
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
    month, day = found["m"], int(found["d"])
    number = int(month) if month.isdigit() else MONTHS.index(month.lower()) + 1
    if number > 12 >= day:
        number, day = day, number
    at = np.datetime64(f"{found['y']}-{number:02d}-{day:02d}", "ns").astype(np.int64)
    return float(at) + _clock(found)


def _clock(found: re.Match[str]) -> float:
    """ns since midnight of `h`, `min`, `s` and `half`, a.m. or p.m."""
    hours = int(found["h"])
    if found["half"]:
        hours = hours % 12 + 12 * (found["half"].lower() == "p")
    if hours > 23 or int(found["min"]) > 59 or _seconds(found["s"]) > 61.0:  # a leap second is a time
        raise ValueError(f"no time of a day: {found[0]}")
    return GIGA * ((hours * 60.0 + int(found["min"])) * 60.0 + _seconds(found["s"]))


def _seconds(text: str) -> float:
    """Of 05.25, 05,25 and 05:250."""
    return float(text.replace(",", ".").replace(":", "."))


def _duration(found: re.Match[str]) -> float:
    days, hours, minutes = (int(part or 0) for part in found.groups()[:3])
    return GIGA * (((24.0 * days + hours) * 60.0 + minutes) * 60.0 + _seconds(found[4]))


def _minutes(found: re.Match[str]) -> float:
    return GIGA * (60.0 * int(found[1]) + _seconds(found[2]))


def _measured(found: re.Match[str]) -> float:
    return GIGA * SECONDS[found[2]] * float(found[1])


FORMS = (
    *((form, _date) for form in (ISO, MATLAB, DAY_FIRST, SLASHES)),
    *((HALVES, _clock), (DURATION, _duration), (MINUTES, _minutes), (MEASURED, _measured)),
)
