"""Words for a part of a claim: the comparison, the claim, and the result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

from etude.report import number
from etude_studies.site.words import listed, measure_name, plural, test_name
from etude_studies.thesis.ledger import Part
from etude_studies.thesis.part_verdicts import DEPENDS, NOT_RUN, UNDECIDED, UNTESTED, PartVerdict
from etude_studies.thesis.parts import in_logs
from etude_studies.thesis.verdict_file import shown
from etude_studies.thesis.verdicts import Verdict

COUNTED: Mapping[str, str] = {
    "Q": "flights",
    "P": "flights",
    "L": "flights",
    "T": "points",
    "K": "spectral points",
}
"""What k counts, by the first letter of a run; trajectories elsewhere."""
STATISTICS: Mapping[str, str] = {
    "ratio": "{m} of {a}, over that of {b}; the mean of the logarithms {at}",
    "ratio_each": "{m} of {a}, over that of {b}; each {at} by itself",
    "rises": "the share of steps {at} at which {m} of {a} rises by more than 2 %",
    "slope": "by how much the logarithm of {m} of {a} falls with each of the {counted}, {at}",
    "value": "{m} of {a}, {at}",
    "gap": "how far {m} of {a} and of {b} are apart, as a factor, {at}",
    "shrinks": "how far {m} of {a} and of {b} are apart {first}, over how far they are {last}",
    "rank": "the rank of {a} among {among} by {m} (1 is the least), {at}",
    "reach": "how many {counted} {a} needs to reach {m} that {b} has {last}, over how many that took",
    "spread": "the largest over the smallest {m} among {among}, {at}",
    "largest": "{m} of {a} in {part}, over the largest of the other parts, {at}",
    "smallest": "{m} of {a} in {part}, over the smallest of the other parts, {at}",
}
REST: Mapping[str, str] = {
    "rises": ", less that of {b}",
    "slope": ", less that of {b}",
}
"""Added where a second source is given."""


ROUNDING = 1e-12
"""A difference below it is the rounding of a sum that is 0."""
Names = Callable[[str], str]
"""A source in words."""


def compared(part: Part, name_of: Names, k: int | None = None) -> str:
    """The statistic of a part as a phrase; of one count `k` where each is judged by itself."""
    at = (k,) if k is not None else part.at
    counted = _counted(part)
    after = _after(at, counted)
    if k is not None:
        phrase = "{m} of {a}, over that of {b}, {at}"
    else:
        phrase = STATISTICS[part.statistic] + (REST.get(part.statistic, "") if part.b else "")
    names = {name: name_of(source) for name, source in (("a", part.a), ("b", part.b))}
    others = listed([name_of(source) for source in part.among]) if part.among else ""
    filled = phrase.format(
        m=measure_name(part.measure),
        at=after,
        among=others,
        counted=counted,
        part=part.part,
        first=_after(part.at[:1], counted),
        last=_after(part.at[-1:], counted),
        **names,
    )
    return filled.rstrip(", ") + _rest(part, name_of)


def _rest(part: Part, name_of: Names) -> str:
    """What is set against it, where it is measured."""
    out = ""
    if part.statistic == "gap" and part.c:
        out += f", over how far {name_of(part.c)} and {name_of(part.d)} are apart"
    if part.against:
        out += f"; against the same {_after(part.against, _counted(part))}"
    if part.bound:
        out += f", {'over' if in_logs(part) else 'less'} {number(part.bound)}"
    where = [test_name(part.test)] if part.test else []
    where += (
        [part.part] if part.part not in ("mean", "") and part.statistic not in ("largest", "smallest") else []
    )
    return out + (f" ({', '.join(where)})" if where else "")


def claimed(part: Part) -> str:
    """ "claimed to be below 1", ..."""
    centre = "1" if in_logs(part) else "0"
    phrases = {"less": f"below {centre}", "more": f"above {centre}", "equal": f"{centre}, within the margin"}
    return f"claimed to be {phrases[part.claim]}"


def estimate(part: PartVerdict) -> str:
    """ "0.88 [0.81, 0.95]"; empty without numbers."""
    if part.estimate is None or part.low is None or part.high is None:
        return ""
    estimate, low, high = (0.0 if abs(v) < ROUNDING else v for v in (part.estimate, part.low, part.high))
    return f"{number(estimate)} [{number(low)}, {number(high)}]"


def shown_part(part: PartVerdict) -> str:
    """Its word, or that its runs are missing."""
    return NOT_RUN if part.reason.startswith(NOT_RUN) else part.word


def level(part: Part, result: PartVerdict) -> str:
    """ "measured 0.95 [0.92, 0.98]", of a value that is set against a bound; else empty."""
    numbers = (result.estimate, result.low, result.high)
    if part.statistic not in ("value", "rank") or not part.bound:
        return ""
    measured = [v * part.bound if part.log else v + part.bound for v in numbers if v is not None]
    return (
        f"measured {number(measured[0])} [{number(measured[1])}, {number(measured[2])}]"
        if len(measured) == 3
        else ""
    )


def evidence(part: PartVerdict) -> str:
    """Estimate, wins and seeds in a few words."""
    effect = estimate(part)
    return f"{effect}, {part.wins} of {plural(part.seeds, 'seed')} on the claimed side" if effect else ""


def deciding(verdict: Verdict) -> PartVerdict | None:
    """The part whose word is the verdict's, the first of them."""
    return next((part for part in verdict.parts if part.word == verdict.word), None)


def sentence(verdict: Verdict, subject: str = "") -> str:
    """The verdict as one sentence; `subject` names the deciding quantity."""
    word = shown(verdict)
    part = deciding(verdict)
    facts = evidence(part) if part is not None else ""
    many = len(verdict.parts)
    if facts and many > 1:
        counts = Counter(shown_part(outcome) for outcome in verdict.parts)
        outcomes = ", ".join(f"{n} × {outcome}" for outcome, n in counts.items())
        facts = f"{facts}. Its {many} comparisons: {outcomes}"
    if word == NOT_RUN or verdict.word == UNTESTED:
        return _capital(verdict.reason.rstrip(".")) + "."
    opening = {
        "holds": "The claim holds",
        "reversed": "The opposite is found",
        "tie": "What is compared is equal within the margin",
        UNDECIDED: "These seeds do not decide it",
        DEPENDS: "It depends on what a step is",
    }[verdict.word]
    facts = f"{subject}: {facts}" if subject and facts else facts
    reason = f"; {verdict.reason}" if verdict.reason else ""
    return f"{opening}: {facts}{reason}." if facts else f"{opening}{reason}."


def printed_words(part: PartVerdict) -> str:
    """The thesis's own number, and whether a single run like it would be an ordinary one here."""
    if part.printed is None:
        return ""
    if part.ordinary is None:
        return f"{number(part.printed)} in the thesis"
    ordinary = "an ordinary draw" if part.ordinary else "not an ordinary draw"
    return f"{number(part.printed)} in the thesis: {ordinary} of a single run here"


def _counted(part: Part) -> str:
    source = part.a or next(iter(part.among), "")
    return COUNTED.get(source[:1], "trajectories")


def _after(at: tuple[int, ...], counted: str) -> str:
    noun = counted.removesuffix("s") if at == (1,) and counted != "trajectories" else counted
    noun = "trajectory" if at == (1,) and counted == "trajectories" else noun
    return f"{'with' if 'points' in counted else 'after'} {listed(at)} {noun}" if any(at) else ""


def _capital(phrase: str) -> str:
    return phrase[:1].upper() + phrase[1:]
