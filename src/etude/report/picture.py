"""The learning curve as one SVG file, for a README or a slide: the report's own panels, on their own.

Regenerate a picture with `python -m etude.report.picture CAMPAIGN_FOLDER OUT.svg`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from etude.errors import UsageError
from etude.report.curves import tests
from etude.report.markup import Html
from etude.report.pictures import alone
from etude.report.record import Record, read_record
from etude.report.sections.learning import learning_panel
from etude.storage import write_atomic


def write_picture(folder: Path, path: Path) -> Path:
    """Write the learning curves of a simulated campaign, side by side, to `path` (SVG), and return it.

    Raises:
        UsageError: the folder is not a campaign's, or it has no evaluation to draw.
    """
    write_atomic(Path(path), learning_picture(read_record(Path(folder))).encode("utf-8"))
    return Path(path)


def learning_picture(record: Record) -> Html:
    """A standalone SVG with one panel per test motion (two at most), light or dark as the reader's system is.

    Raises:
        UsageError: the campaign has no evaluation.
    """
    drawn = [learning_panel(test) for test in tests(record) if test.learned][:2]
    if not drawn:
        raise UsageError(
            "this campaign has no evaluation to draw",
            where=str(record.folder),
            next_step="Only `etude simulate` and `etude demo` evaluate a controller.",
        )
    return alone(drawn)


def main(arguments: list[str]) -> None:
    """Entry of `python -m etude.report.picture`."""
    if len(arguments) != 2:
        raise UsageError(
            "two arguments are needed", next_step="Give the campaign's folder and the SVG's path."
        )
    write_picture(Path(arguments[0]), Path(arguments[1]))


if __name__ == "__main__":
    main(sys.argv[1:])
