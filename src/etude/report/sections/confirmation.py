"""The proof on the robot: motions never learned from, without and with the learned feedforward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from etude.report.markup import Html, number, paragraph, section, table
from etude.report.record import Record

TITLE = "Proof on the robot: without and with the feedforward"
HEADER = ("axis", "without", "with", "with, forecast", "unit")


def confirmation(record: Record) -> Html:
    """A table for each motion that confirms; nothing where none was run."""
    from etude.campaign.confirmed import confirmed

    if record.campaign is None:
        return Html("")
    found = [confirmed(record.campaign, one) for one in record.state.confirmations]
    told = [one for one in found if one["units"] is not None]
    if not told:
        return Html("")
    text = paragraph(
        "Mean absolute tracking errors on a motion that no model was trained on, under the robot's own "
        "feedback alone and with the commands of the model in use. The forecast was written with the motion: "
        "the part of the command that the model does not know, times the error without it."
    )
    return section("confirmation", TITLE, text, *(_table(one) for one in told))


def _table(one: Mapping[str, Any]) -> Html:
    columns = [one[key] or [None] * len(one["axes"]) for key in ("without", "with", "forecast")]
    rows = [
        [axis, *(number(value) for value in values), unit]
        for axis, unit, *values in zip(one["axes"], one["units"], *columns, strict=True)
    ]
    return Html(paragraph(f"Trajectory {one['number']}.") + table(HEADER, rows))
