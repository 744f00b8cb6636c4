"""Names of runs, measures, tests and verdicts on the pages; unknown names are printed as they are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from etude_studies.thesis.part_verdicts import DEPENDS, NOT_RUN, UNTESTED

BEYOND = "beyond"
"""Section of the entries that the thesis does not have."""


@dataclass(frozen=True)
class Word:
    """A verdict as it is shown: never by its colour alone.

    Attributes:
        mark: beside the word. name: of its class in the style sheet. meaning: in a sentence.
    """

    mark: str
    name: str
    meaning: str


WORDS: Mapping[str, Word] = {
    "holds": Word("✓", "holds", "The seeds show what is claimed."),
    "reversed": Word("✗", "reversed", "The seeds show the opposite of what is claimed."),
    "tie": Word("=", "tie", "Neither: what is compared is equal within the margin."),
    "not decided": Word("?", "undecided", "These seeds show neither a difference nor that there is none."),
    DEPENDS: Word("≷", "reading", "The thesis can be read in several ways, and the word is not the same."),
    UNTESTED: Word("–", "untested", "No run of this study can answer it; the reason is given."),
    NOT_RUN: Word("…", "notrun", "The runs that answer it are not there, or not complete."),
}

LINES: Mapping[str, str] = {
    "O1:none": "no learning on line",
    "O1:variance": "learning on line, variance rule",
    "O1:error": "learning on line, error rule",
    "T1:exact": "an exact process, with its samples n",
    "T1:exact_extrapolated": "an exact process, extrapolated",
    "T1:dictionary": "the dictionary",
    "T1:spectrum": "a sparse spectrum, with its points m",
    "T1:spectrum_n": "a sparse spectrum, with its samples n",
    "B0": "PD alone",
    "B1": "exact inverse",
    "B2": "exact inverse without friction",
    "X14": "500 samples evenly spread",
    "Y1": "iterative learning control",
    "Y6": "adaptive control",
    "linear": "linear regression",
    "identified": "identified physics",
    "identified_measured": "identified physics, measured inputs",
    "nominal": "nominal model",
    "faded": "feedforward faded",
    "again": "same members, trained from the start values",
}
MEASURES: Mapping[str, str] = {
    "error": "mean tracking error",
    "error_rms": "root mean square tracking error",
    "mae": "mean prediction error",
    "variance": "predicted variance",
    "variance_noisy": "predicted variance with noise",
    "deviation": "predicted deviation",
    "length": "length scale",
    "kernel_rms": "root mean square error of the kernel",
    "feedback_share": "feedback's share of the command",
    "feedback_median": "median feedback over the command",
    "feedback_p95": "95 % quantile of feedback over the command",
    "reversal_share": "share of the error near reversals",
    "stuck_share": "share of reversals at which the joint sticks",
    "after_reversal": "share of the error between reversals and the next motion",
    "after_reversal_time": "share of the time between reversals and the next motion",
    "stuck_after": "share of reversals after which the joint sticks",
    "undershoot": "undershoot at the extremes",
    "undershoot_max": "undershoot at the maxima",
    "undershoot_min": "undershoot at the minima",
    "spike": "largest error near a maximum over the median",
    "jerk": "jerkiness of the motion",
    "nmse": "normalised error of the predicted command",
    "nlpd": "negative log predictive density",
    "nlml": "negative log marginal likelihood",
    "nearest": "distance of new data to old data",
    "coverage68": "coverage of the 68 % bounds",
    "coverage95": "coverage of the 95 % bounds",
    "spearman": "rank correlation of deviation and error",
    "z2": "mean square of standardised errors",
    "ahead_variance": "variance on a trajectory before it is learned",
    "ahead_mae": "error on a trajectory before it is learned",
    "cpu_train": "processor time of training",
    "cpu_predict": "processor time of prediction",
    "cpu_design": "processor time of design",
    "cpu_swap": "processor time of an exchange in the dictionary",
    "cpu_slope_mean": "growth (as a power) of the time of a mean",
    "cpu_slope_variance": "growth (as a power) of the time of a variance",
    "cpu_slope_train": "growth (as a power) of the time of training",
    "cpu_train_hours": "hours of training",
    "effort": "effort of the command",
    "fill": "largest gap of the data",
    "gap95": "gap of the data, 95 % quantile",
    "length_change": "change of the length scales in logarithms",
}
TESTS: Mapping[str, str] = {
    "friction": "friction grown by half after the first pass",
    "payload": "0.5 kg carried after the first pass",
    "fourier": "each seed's own test motion",
    "common": "one test motion common to all seeds",
    "moves": "point-to-point moves",
    "uniform": "uniform test flights",
    "boundary": "test flights on the edge of the limits",
    "extreme": "extreme test flights",
    "single": "one test flight for each seed",
    "fresh": "a fresh test flight each time",
}
UNITS: Mapping[str, str] = {"1": "", "PWM2": "PWM²", "rad, rad/s, rad/s2": "rad, rad/s, rad/s²"}
COLUMNS = re.compile(r"(q|qd|qdd)_des_(\w+)")
SIGNS = {"q": "q", "qd": "q̇", "qdd": "q̈"}


def line_name(source: str, what: Mapping[str, str]) -> str:
    """A source in a few words: a known line, else the run's sentence, else its id."""
    run, _, model = source.partition(":")
    if source in LINES:
        return LINES[source]
    if model == "faded":
        return f"{run} with fading feedforward"
    if model:
        return LINES.get(model, model.replace("_", " "))
    return what.get(run, run)


def source_name(source: str, what: Mapping[str, str]) -> str:
    """The same with the id before it, for tables that list many."""
    name = line_name(source, what)
    return source if name == source else f"{source}: {name}"


def row_name(source: str, names: Mapping[str, str], what: Mapping[str, str]) -> str:
    """A source by the label that a table gives it, or in a few words, with its id behind it."""
    name = names.get(source) or line_name(source, what)
    return source if name == source else f"“{name}” ({source})"


def measure_name(measure: str) -> str:
    if measure.startswith("length_"):
        return f"length scale of {column_name(measure.removeprefix('length_'))}"
    return MEASURES.get(measure, measure.replace("_", " "))


def test_name(test: str) -> str:
    return TESTS.get(test, test)


def unit_name(unit: str) -> str:
    return UNITS.get(unit, unit)


def axis_label(measure: str, unit: str) -> str:
    """Title of an axis."""
    sign = unit_name(unit)
    return f"{measure_name(measure)} ({sign})" if sign else measure_name(measure)


def column_name(column: str) -> str:
    """A column's heading: joints by their names, inputs by their symbols."""
    match = COLUMNS.fullmatch(column)
    return f"{SIGNS[match[1]]} {match[2]}" if match else column.replace("_", " ")


def entry_name(id: str) -> str:
    """ "table-6.9" as "Table 6.9"; what goes beyond the thesis as "Beyond: criteria"."""
    kind, _, number = id.partition("-")
    return f"{kind.capitalize()} {number}" if number[:1].isdigit() else f"{kind.capitalize()}: {number}"


def section_name(section: str) -> str:
    """ "Section 6.2 of the thesis", or what stands for it."""
    if section[:1].isdigit():
        return f"Section {section} of the thesis"
    return "Beyond the thesis" if section == BEYOND else section.capitalize()


def listed(items: Sequence[object]) -> str:
    """ "1, 2 and 3"; a row of more than two numbers without a gap is "1 to 3"."""
    if len(items) > 2 and all(isinstance(i, int) for i in items):
        numbers = [int(str(i)) for i in items]
        if numbers == list(range(numbers[0], numbers[-1] + 1)):
            return f"{numbers[0]} to {numbers[-1]}"
    texts = [str(item) for item in items]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"


def plural(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def once(items: Iterable[str]) -> tuple[str, ...]:
    """Each once, in their order."""
    return tuple(dict.fromkeys(items))
