"""The page of one claim: the quotation, what is compared, the numbers, and the verdict in a sentence."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from etude.report import Html, element, join, number, paragraph, table
from etude_studies.site.claim_words import (
    Names,
    claimed,
    compared,
    deciding,
    estimate,
    level,
    printed_words,
    sentence,
    shown_part,
)
from etude_studies.site.context import Study
from etude_studies.site.dot_plot import Dot, dot_plot
from etude_studies.site.downloads import data_links
from etude_studies.site.entry_more import reading_name
from etude_studies.site.marks import Style, figure
from etude_studies.site.mathematics import prose
from etude_studies.site.numbers import Summary
from etude_studies.site.page import chip, command, file_of, folded, link, page, word_chip
from etude_studies.site.seed_plot import Strip, seed_plot
from etude_studies.site.words import entry_name, measure_name, plural, row_name, section_name
from etude_studies.thesis.catalogue import catalogue
from etude_studies.thesis.choosing import runs_of
from etude_studies.thesis.contrasts import EACH
from etude_studies.thesis.kept import price_s
from etude_studies.thesis.ledger import Claim, Part
from etude_studies.thesis.part_verdicts import DEPENDS, NOT_RUN, UNTESTED, PartVerdict
from etude_studies.thesis.parts import in_logs, run_of
from etude_studies.thesis.readings import EQUAL, ON_PLANT, Reading
from etude_studies.thesis.verdict_file import Verdict, shown

KINDS = {
    "own": "a result of the thesis",
    "mech": "an explanation that the thesis gives",
    "obs": "an observation of one run",
    "cited": "what the thesis takes from others",
    "alias": "said before in other words",
}
DOT = Style("c1", "circle", "")
FACTOR, DIFFERENCE = "factor; 1 is no difference", "difference; 0 is none"


def claim_page(study: Study, claim: Claim) -> Html:
    """The whole page."""
    verdict = study.verdicts[claim.id]
    parts = _parts(study, claim)
    return page(
        f"Claim {claim.id}",
        element("h1", f"Claim {claim.id}"),
        paragraph(_about(claim, verdict), class_="soft"),
        element("blockquote", prose(" … ".join(claim.quote))),
        element(
            "p", chip(verdict), " ", sentence(verdict, _short(study, claim, parts)), class_="lead verdict"
        ),
        _again(verdict),
        _steps(study, claim, verdict),
        _short_of_seeds(study, claim),
        _picture(parts, verdict),
        _table(_names(study, claim), parts, verdict),
        _why(study, claim, verdict),
        _thesis_notes(claim),
        _command(study, claim, verdict),
        _stability(study, claim, verdict),
        _readings(study, claim, verdict),
        _seeds(study, claim),
        _tests(parts, verdict),
    )


def _names(study: Study, claim: Claim) -> Names:
    """Sources by the labels of the tables behind the claim, and behind those that it says again.

    Where two have the same label, each is named by what its run is.
    """
    names: dict[str, str] = {}
    for one in (claim, *(study.ledger.claim(id) for id in claim.alias_of)):
        names = study.names(one) | names
    read = {source for _, part in _parts(study, claim) for source in part.sources}
    labels = Counter(label for source, label in names.items() if source in read)
    names = {source: label for source, label in names.items() if labels[label] <= 1}
    return lambda source: row_name(source, names, study.what)


def _short(study: Study, claim: Claim, parts: Sequence[tuple[str, Part]]) -> str:
    """What the deciding number is of, where it is a plain ratio or a value against a bound."""
    verdict = study.verdicts[claim.id]
    first = deciding(verdict)
    part = next((candidate for candidate, result in _matched(parts, verdict) if result is first), None)
    if part is None:
        return ""
    names = _names(study, claim)
    if part.statistic == "value" and part.bound and not part.log:
        return f"{measure_name(part.measure)}, less {number(part.bound)}"
    return f"{names(part.a)} over {names(part.b)}" if part.statistic in ("ratio", EACH) else ""


def _about(claim: Claim, verdict: Verdict) -> Html:
    kind = KINDS[claim.kind]
    phrases = [section_name(claim.section), kind]
    phrases += ["judged in simulation in place of hardware"] if verdict.simulated else []
    phrases += ["exploratory: not among the thesis's own results"] if verdict.exploratory else []
    rests = [link(file_of(id), entry_name(id)) for id in claim.rests_on]
    return join([" · ".join(phrases), *([Html(" · rests on "), join(rests, ", ")] if rests else [])], "")


def _parts(study: Study, claim: Claim) -> list[tuple[str, Part]]:
    """The parts that the verdict's numbers are of, with the id of their claim."""
    claims = [study.ledger.claim(id) for id in claim.alias_of] or [claim]
    return [(one.id, part) for one in claims for part in one.parts]


def _again(verdict: Verdict) -> Html:
    if not verdict.same_as:
        return Html("")
    links = [link(file_of(id), id) for id in verdict.same_as]
    return paragraph("It says again ", join(links, ", "), ", and has the verdict of that.")


def _why(study: Study, claim: Claim, verdict: Verdict) -> Html:
    """Of a reversed claim: what was recorded beside, and the readings under which it holds."""
    if verdict.word != "reversed":
        return Html("")
    explanation = next(
        (candidate for id in (claim.id, *claim.alias_of) if (candidate := study.ledger.why(id))), None
    )
    names, items = _names(study, claim), []
    for part in explanation.parts if explanation else ():
        phrase, numbers = compared(part, names), study.recorded(part)
        facts = estimate(numbers) or numbers.reason
        items.append(element("li", f"{phrase[:1].upper()}{phrase[1:]}: {facts}, n = {numbers.seeds}."))
    content = [paragraph(explanation.words), element("ul", *items)] if explanation else []
    return join([element("h2", "Why"), *content, paragraph(_returns(study, claim))])


def _returns(study: Study, claim: Claim) -> str:
    """The settings under which the thesis's word returns, among those that have been run."""
    run = [
        (reading.name, other.word) for reading, other in study.readings_of(claim) if shown(other) != NOT_RUN
    ]
    settings = [name for name, word in run if word == "holds"]
    if not settings:
        return f"Settings under which the claim holds: none found among {plural(len(run), 'reading')}."
    return f"The claim holds under: {'; '.join(settings)} ({len(settings)} of {plural(len(run), 'reading')})."


def _steps(study: Study, claim: Claim, verdict: Verdict) -> Html:
    """The word under the other readings of a step; of one that depends on them the verdict tells."""
    if verdict.word == DEPENDS:
        return Html("")
    outcomes = [
        f"{reading.name}: {shown(other)}"
        for reading, other in study.readings_of(claim)
        if reading.ambiguity == EQUAL
    ]
    note = f"Here steps are line searches. Read otherwise: {'; '.join(outcomes)}."
    return paragraph(note, class_="soft") if outcomes else Html("")


def _short_of_seeds(study: Study, claim: Claim) -> Html:
    """Runs with fewer seeds than planned, which the verdict rests on all the same."""
    if claim.untestable:
        return Html("")
    counts = [(run, study.planned.get(run, 0), catalogue()[run].seeds) for run in runs_of(claim.id)]
    lack = [f"{run} {n} of {planned} planned seeds" for run, n, planned in counts if 1 < n < planned]
    return paragraph(f"Run so far: {', '.join(lack)}.", class_="soft") if lack else Html("")


def _matched(parts: Sequence[tuple[str, Part]], verdict: Verdict) -> list[tuple[Part, PartVerdict]]:
    """Each judged part with what was asked: "ratio_each" is judged once for every count."""
    expanded = [part for _, part in parts for _ in (part.at if part.statistic == EACH else (0,))]
    return list(zip(expanded, verdict.parts, strict=False))


def _picture(parts: Sequence[tuple[str, Part]], verdict: Verdict) -> Html:
    """Estimates with intervals, the margin shaded, and what a single run would give in faint lines."""
    drawn = [_dots(parts, verdict, log=log) for log in (True, False)]
    shown = [figure(f"estimates {place}", one) for place, one in enumerate(drawn) if one]
    if not shown:
        return Html("")
    caption = "Bars: 95 % interval of the mean; faint: where a single run lies; shaded: counts as equal."
    diamond = " Hollow diamond: the thesis's own number." if any(p.printed for p in verdict.parts) else ""
    return join([*shown, paragraph(caption + diamond, class_="soft")])


def _dots(parts: Sequence[tuple[str, Part]], verdict: Verdict, *, log: bool) -> Html:
    pairs = [(part, result) for part, result in _matched(parts, verdict) if result.log is log]
    estimated = [(part, result) for part, result in pairs if result.estimate is not None]
    if not estimated:
        return Html("")
    dots = [_dot(result) for _, result in estimated]
    margin = estimated[0][1].margin if len({result.margin for _, result in estimated}) == 1 else None
    band = None if margin is None else (1.0 / margin, margin) if log else (-margin, margin)
    title, axis = "Estimates", FACTOR if log else DIFFERENCE
    return dot_plot(title, dots, axis=axis, log=log, band=band, centre=1.0 if log else 0.0)


def _dot(result: PartVerdict) -> Dot:
    mean, low, high = (math.nan if v is None else v for v in (result.estimate, result.low, result.high))
    mean_interval = Summary(mean, low, high, result.seeds)
    single = None
    if result.single_low is not None and result.single_high is not None:
        single = result.single_low, result.single_high
    name = f"{_number(result)} {result.word}"
    return Dot(name, mean_interval, result.printed, DOT, single=single)


def _number(result: PartVerdict) -> str:
    return f"({result.part + 1})" + (f" at {result.k}" if result.k is not None else "")


def _table(names: Names, parts: Sequence[tuple[str, Part]], verdict: Verdict) -> Html:
    """What is compared, part by part."""
    items = [element("li", *_item(names, part, result)) for part, result in _matched(parts, verdict)]
    return (
        join([element("h2", "What is compared"), element("ol", *items, class_="parts")])
        if items
        else Html("")
    )


def _item(names: Names, part: Part, result: PartVerdict) -> list[object]:
    phrase = compared(part, names, result.k)
    first = [element("b", _number(result)), f" {phrase[:1].upper()}{phrase[1:]}; {claimed(part)}."]
    if result.estimate is None:
        return [
            *first,
            paragraph(word_chip(shown_part(result)), f" {result.reason.removeprefix(f'{NOT_RUN}: ')}."),
        ]
    facts = [estimate(result), *filter(None, [level(part, result)])]
    facts += [f"{result.wins} of {plural(result.seeds, 'seed')} on the claimed side"]
    facts += [f"{plural(result.failed, 'seed')} without a number"] if result.failed else []
    facts += [printed_words(result)] if result.printed is not None else []
    facts += [f"power {number(result.power, 2)} for {_margin(result)}"] if result.power is not None else []
    facts += [f"{result.needed} seeds would decide it"] if result.needed else []
    facts += [] if result.agree else ["the two tests disagree, and the weaker counts"]
    return [*first, paragraph(word_chip(result.word), " ", "; ".join(facts), ".")]


def _margin(result: PartVerdict) -> str:
    """The smallest effect of interest."""
    return f"a {'factor' if result.log else 'difference'} of {result.margin:.4g}"


def _thesis_notes(claim: Claim) -> Html:
    """The thesis's own numbers, notes, and what it says otherwise elsewhere."""
    rows = [("The thesis's own number", claim.thesis), ("How it is read", claim.note)]
    rows += [("The thesis says otherwise", claim.contradicts)]
    parts = [element("dt", title) + element("dd", prose(content)) for title, content in rows if content]
    return element("dl", *map(Html, parts)) if parts else Html("")


def _command(study: Study, claim: Claim, verdict: Verdict) -> Html:
    if claim.untestable:
        return Html("")
    line, cost = f"etude study run {claim.id}", study.price(claim.id, verdict.block)
    line += f" --seeds {verdict.block}" if verdict.block else ""
    intro = paragraph(f"The command that computes these numbers again, with as many seeds as planned{cost}:")
    again = [intro, command(line), command(f"etude study show {claim.id}"), data_links(claim.id)]
    return join([*_more_seeds(study, claim, verdict.asks), *again])


def _more_seeds(study: Study, claim: Claim, asks: int | None) -> list[Html]:
    """What would decide a claim, and what that costs."""
    if not asks:
        return []
    cost = study.price(claim.id, asks, more=True)
    intro = f"{asks} seeds would decide it at this spread. They count once, all together{cost}:"
    seeds = f"etude study run {claim.id} --seeds {asks} --go-on"
    return [paragraph(intro), command(seeds), command("etude study report --folder results")]


def _stability(study: Study, claim: Claim, verdict: Verdict) -> Html:
    """On how many arms with other gains, friction or noise the word is the same."""
    outcomes = [
        shown(other) for reading, other in study.readings_of(claim) if reading.name.startswith(ON_PLANT)
    ]
    run = [word for word in outcomes if word != NOT_RUN]
    if not run:
        return Html("")
    same = sum(word == verdict.word for word in run)
    lack = f"; {len(outcomes) - len(run)} are not run yet" if len(run) < len(outcomes) else ""
    note = f"The same word on {same} of {len(run)} arms with other gains, friction or noise{lack}."
    return paragraph(note)


def _lacking(study: Study, claim: Claim, reading: Reading) -> str:
    """A reading not run, with the runs that it lacks, and their cost: that of the runs which they replace."""
    runs = {run_of(source) for _, part in _parts(study, claim) for source in part.sources}
    new = {old: reading.replace[old] for old in sorted(runs) if old in reading.replace}
    if not new or not all(name in catalogue() for name in new.values()):
        return reading.name
    lack = {old: name for old, name in new.items() if name not in study.numbers.results.runs}
    cost = sum(price_s([old], catalogue()[name].seeds, study.numbers.results) for old, name in lack.items())
    return f"{reading.name} ({', '.join(lack.values())}, {number(cost, 2)} s)" if lack else reading.name


def _readings(study: Study, claim: Claim, verdict: Verdict) -> Html:
    every = study.readings_of(claim)
    computed = [(reading, other) for reading, other in every if shown(other) != NOT_RUN]
    missing = [_lacking(study, claim, reading) for reading, other in every if shown(other) == NOT_RUN]
    heading = "Not run with every side (missing runs, CPU time of those that they replace)"
    lack = paragraph(f"{heading}: {'; '.join(missing)}.", class_="soft") if missing else ""
    if not computed:
        return Html(lack)
    sources = {source for _, part in _parts(study, claim) for source in part.sources}
    rows: list[list[object]] = [["as above", chip(verdict), ""]]
    for reading, other in computed:
        part = deciding(other)
        decided = f"{_number(part)}: {estimate(part)}" if part is not None and estimate(part) else ""
        rows.append([reading_name(reading, sources), chip(other), decided])
    header = ["read so", "verdict", "what decides"]
    return folded(
        "The verdict under other readings", table(header, rows), lack, note=_turns(study, claim, computed)
    )


def _turns(study: Study, claim: Claim, computed: Sequence[tuple[Reading, Verdict]]) -> str:
    """Whether another reading has another word."""
    on, word = study.depends(claim), study.verdicts[claim.id].word
    if on:
        return f"depends on: {'; '.join(on)}"
    others = Counter(other.word for _, other in computed if other.word != word)
    if others:
        return ", ".join(f"{n} of {len(computed)}: {other}" for other, n in others.items())
    return "the same word under each of them"


def _seeds(study: Study, claim: Claim) -> Html:
    """x of each seed, as a factor where it is a logarithm."""
    drawn = []
    for index, part in enumerate(claim.parts):
        log = in_logs(part)
        strips: list[Strip] = []
        for contrast in study.contrasts_of(claim, part):
            values = {seed: math.exp(x) if log else x for seed, x in contrast.x.items()}
            name = f"({index + 1})" + (f" at {contrast.k}" if contrast.k is not None else "")
            if values:
                strips.append((name, values, DOT, {}))
        if strips:
            axis, centre = (FACTOR, 1.0) if log else (DIFFERENCE, 0.0)
            drawn.append(
                figure(
                    f"seeds {index}", seed_plot(f"Seeds of ({index + 1})", strips, axis=axis, centre=centre)
                )
            )
    return folded("Every seed", join(drawn)) if drawn else Html("")


def _tests(parts: Sequence[tuple[str, Part]], verdict: Verdict) -> Html:
    """All numbers of the tests, for who wants to check the rule."""
    rows = [
        [
            _number(result),
            _interval(result.low, result.high),
            _interval(result.narrow_low, result.narrow_high),
            _interval(result.bca_low, result.bca_high),
            number(result.sd),
            f"{number(result.p, 2)} / {number(result.p_permutation, 2)}",
            f"{number(result.p_adjusted, 2)} / {number(result.p_permutation_adjusted, 2)}",
            number(result.level, 2),
            number(result.power, 2),
            f"{result.seeds} of {result.planned}",
        ]
        for _, result in _matched(parts, verdict)
        if result.word != UNTESTED
    ]
    if not rows:
        return Html("")
    header = [
        "",
        "95 %",
        "90 %",
        "bootstrap 95 %",
        "sd",
        "p (t / sign flips)",
        "adjusted",
        "p to meet",
        "power",
        "seeds",
    ]
    return folded(
        "The tests in full",
        table(header, rows),
        paragraph(link("about.html#rule", "The rule."), class_="soft"),
    )


def _interval(low: float | None, high: float | None) -> str:
    return f"[{number(low)}, {number(high)}]"
