"""The thesis's protocol and Étude's default one, side by side on the same seeds and tests."""

from __future__ import annotations

from collections.abc import Sequence

from etude.report import Html, element, grid, join, missing_data, paragraph
from etude_studies.site.context import Study
from etude_studies.site.curve_plot import Curve, curve_plot
from etude_studies.site.dot_plot import Dot, Rule, dot_plot
from etude_studies.site.entry_more import settings_of
from etude_studies.site.marks import figure, legend, style_of
from etude_studies.site.page import PROTOCOLS, file_of, folded, link, page
from etude_studies.site.words import axis_label, entry_name, line_name, source_name
from etude_studies.thesis.ledger import Entry

DIFFERENCES = (
    "The thesis trains on what was asked of the robot: desired positions, velocities and accelerations. The "
    "default protocol trains on what the robot did, measured and filtered, with inputs for friction; its "
    "ladder may add an identified rigid body. Both have the same seeds and the same test motions."
)
MAIN = "table-6.10"
"""The entry whose rows are compared: random and designed trajectories, after the last of them."""


def protocols_page(study: Study) -> Html:
    """The whole page; what was not run is said."""
    title = "Two protocols side by side"
    return page(
        title,
        element("h1", title),
        paragraph(DIFFERENCES),
        *_body(study),
        here=PROTOCOLS,
    )


def _body(study: Study) -> Sequence[Html]:
    entry = next((item for item in study.ledger.entries if item.id == MAIN), None)
    if entry is None or not entry.beside:
        return [missing_data("No table compares the two protocols.")]
    sources = [(row.label, row.run) for row in entry.rows]
    sources += [(run, run) for run in entry.beside]
    lack = [run for run in entry.beside if not study.numbers.by_k(run, entry.measure, entry.test, "mean")]
    note = missing_data(f"Not run yet: {', '.join(lack)}.") if lack else Html("")
    pictures = [item for item in (_dots(study, entry, sources), _curves(study, entry, sources)) if item]
    drawn = join([grid(pictures), legend([(n, style_of(i)) for i, (n, _) in enumerate(sources)])])
    settings = [settings_of(study, run) for _, run in sources]
    folded_in = folded("Every setting of both", *settings)
    return [note, drawn if pictures else Html(""), _entries(study), folded_in]


def _dots(study: Study, entry: Entry, sources: Sequence[tuple[str, str]]) -> Html:
    k = entry.at[-1]
    dots = [
        Dot(name, study.numbers.summary(entry, source, "mean", k), None, style_of(place))
        for place, (name, source) in enumerate(sources)
    ]
    if all(dot.result is None for dot in dots):
        return Html("")
    lines = [(line, study.numbers.summary(entry, line, "mean", k)) for line in entry.lines]
    rules = [Rule(line_name(line, study.what), result.mean) for line, result in lines if result]
    drawn = dot_plot("Both protocols", dots, rules, axis=axis_label(entry.measure, entry.unit))
    return figure("dots protocols", drawn, f"After {k} trajectories, mean of the joints.")


def _curves(study: Study, entry: Entry, sources: Sequence[tuple[str, str]]) -> Html:
    at = tuple(range(1, entry.at[-1] + 1))
    curves = [
        Curve(name, results, style_of(place), {})
        for place, (name, source) in enumerate(sources)
        if (results := study.numbers.curve(entry, source, "mean", at))
    ]
    if not curves:
        return Html("")
    y = axis_label(entry.measure, entry.unit)
    drawn = curve_plot("Both protocols, by trajectory", curves, [], x="trajectories learned", y=y)
    return figure("curves protocols", drawn)


def _entries(study: Study) -> Html:
    """Where else the default protocol stands beside the thesis's."""
    links = [link(file_of(entry.id), entry_name(entry.id)) for entry in study.ledger.entries if entry.beside]
    runs = sorted({run for entry in study.ledger.entries for run in entry.beside})
    items = [element("li", link(file_of(f"run-{run}"), source_name(run, study.what))) for run in runs]
    intro = paragraph("Both stand side by side in ", join(links, ", "), ".")
    return join([element("ul", *items), intro])
