"""The report of a campaign, as one page."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.report.build import build_report
    from etude.report.live import HOST, Pages, digest_of, server
    from etude.report.markup import (
        Html,
        document,
        element,
        grid,
        join,
        missing_data,
        number,
        paragraph,
        table,
        text,
    )
    from etude.report.scales import Axis, Scale, fitted_scale, tick_text
    from etude.report.svg import Line, Mark, panel, polyline, thinned

__all__ = [
    "HOST",
    "Axis",
    "Html",
    "Line",
    "Mark",
    "Pages",
    "Scale",
    "build_report",
    "digest_of",
    "document",
    "element",
    "fitted_scale",
    "grid",
    "join",
    "missing_data",
    "number",
    "panel",
    "paragraph",
    "polyline",
    "server",
    "table",
    "text",
    "thinned",
    "tick_text",
]
__getattr__, __dir__ = face(__name__)
