"""Report of a campaign: `build_report` turns a campaign folder into one self-contained HTML file."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from etude.campaign.record.config_file import CONFIG
from etude.campaign.record.folder import ROBOT
from etude.campaign.record.journal import JOURNAL
from etude.report.live import INDEX, Pages, digest_of
from etude.report.markup import Html, document, element, join, paragraph
from etude.report.record import Record, read_record
from etude.report.sections.headline import headline
from etude.report.sections.learning import learning
from etude.report.sections.model_scores import calibration, selection, uncertainty
from etude.report.sections.motion import motion
from etude.report.sections.paths import paths
from etude.report.sections.prediction import prediction
from etude.report.sections.rounds import confirmation, provenance, repairs, rounds
from etude.report.sections.tracking import tracking
from etude.report.sections.trajectories import trajectories
from etude.report.space import asset
from etude.storage import write_atomic

SECTIONS = (
    learning,
    rounds,
    motion,
    paths,
    tracking,
    confirmation,
    prediction,
    uncertainty,
    calibration,
    selection,
    trajectories,
    repairs,
    provenance,
)
"""Every part of a page, in the order of reading; one that has nothing to say of a robot is empty. A new part
is one function and one place in this row."""

CONTENTS = {
    "learning": "learning curve",
    "rounds": "cost of each round",
    "motion": "the robot in motion",
    "paths": "paths in space",
    "tracking": "desired against actual",
    "confirmation": "proof on the robot",
    "prediction": "predicted against measured",
    "uncertainty": "uncertainty",
    "calibration": "calibration",
    "selection": "model selection",
    "trajectories": "trajectories and proofs",
    "repairs": "repairs",
    "provenance": "provenance",
}


def build_report(folder: Path) -> Path:
    """Writes `folder`/report.html from the campaign's files, and returns its path.

    The page needs no network and no server: drawings are inline SVG, and its own style sheet gives the
    colours. It is never the source of truth. A sentence replaces each part without data.

    Raises:
        UsageError: the folder holds no campaign, or its journal was edited.
        EtudeError: the file cannot be written.
    """
    folder = Path(folder)
    path = folder / "report.html"
    write_atomic(path, render(read_record(folder)).encode("utf-8"))
    return path


def live_report(folder: Path) -> Pages:
    """The same page for a server, made anew after a change of the journal, the robot or the configuration."""
    folder = Path(folder)
    watched = [folder / name for name in (JOURNAL, ROBOT, CONFIG)]
    return Pages(lambda: {INDEX: cache(lambda: render(read_record(folder)))}, lambda: digest_of(watched))


def render(record: Record) -> Html:
    """The whole page."""
    title = f"Étude report: {record.robot}"
    drawn = {draw.__name__: draw(record) for draw in SECTIONS}
    links = (element("a", CONTENTS[key], href=f"#{key}") for key, part in drawn.items() if part)
    contents = element("nav", *links)
    date = record.events[-1].time[:10] if record.events else ""
    subtitle = f"Campaign “{record.folder.resolve().name}”" + (f", last event {date}" if date else "")
    parts = [element("h1", title), paragraph(subtitle, class_="soft"), headline(record), contents]
    parts += [part for part in drawn.values() if part]
    main = Html(f"<main>\n{join(parts)}\n</main>")
    readout = element("div", class_="readout", aria_hidden="true")
    script = element("script", Html(asset("report.js") + asset("space.js")))
    return document(
        title, element("style", Html(asset("report.css") + asset("space.css"))), main, readout, script
    )
