"""The proof on the robot: motions never learned from, without and with the learned feedforward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from etude.report.markup import Html, number, paragraph, section, table
from etude.report.record import Record

TITLE = "Proof on the robot: without and with the feedforward"


def confirmation(record: Record) -> Html:
    """A table for each motion that confirms; nothing where none was run."""
    from etude.campaign.ingest.confirmed import confirmed

    if record.campaign is None:
        return Html("")
    found = [confirmed(record.campaign, one) for one in record.state.confirmations]
    told = [one for one in found if one["units"] is not None]
    if not told:
        return Html("")
    text = paragraph(
        "Mean absolute tracking errors on a motion that no model was trained on, under the robot's own "
        "feedback alone and with the commands of the model in use. The forecast is of the axes while they "
        "move: the part of the command that the model did not claim to know when the motion was written, "
        "times the error without it, and what stays: the encoder's noise, and at most a lag of "
        "all axes. Of one that stands nothing is forecast: friction holds what its command leaves over."
    )
    return section("confirmation", TITLE, text, *(_table(one) for one in told))


def _table(one: Mapping[str, Any]) -> Html:
    from etude.campaign.ingest.confirmed import SHOWN

    columns = [one[key] or [None] * len(one["axes"]) for key in SHOWN]
    rows = [
        [axis, *(_figure(value) for value in values), unit]
        for axis, unit, *values in zip(one["axes"], one["units"], *columns, strict=True)
    ]
    return Html(paragraph(f"Trajectory {one['number']}.") + table(("axis", *SHOWN.values(), "unit"), rows))


def _figure(value: float | tuple[float, float] | None) -> str:
    if isinstance(value, tuple):
        return f"{number(value[0], 2)} .. {number(value[1], 2)}"
    return number(value)
