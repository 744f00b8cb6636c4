"""Where everything comes from: repairs made on the logs, hashes, seed, versions."""

from __future__ import annotations

import platform
from importlib import metadata
from typing import Any

from etude.campaign.record.state import Round
from etude.report.markup import Html, element, join, missing, paragraph, section, table
from etude.report.record import Record


def repairs(record: Record) -> Html:
    """What was changed in each log while reading it; nothing is repaired in silence."""
    title = "Repairs made on the logs"
    told = record.state.told
    if not told:
        return section("repairs", title, missing("No log has come back yet."))
    rows = [[f"{r.number}", sentence] for r in told for sentence in _sentences(record, r)]
    if not rows:
        return section("repairs", title, paragraph(f"None: {len(told)} logs were used as they came."))
    return section("repairs", title, table(["log", "repair"], rows))


def _sentences(record: Record, entry: Round) -> tuple[str, ...]:
    stated = (entry.told or {}).get("repairs")
    if stated is None:
        log = record.log(entry.number)
        stated = log.repairs if log else ()
    return tuple(str(sentence) for sentence in stated)


def provenance(record: Record) -> Html:
    """Configuration hash, seed, versions, and what could not be read."""
    parts: list[Html] = [table(["what", "value"], _facts(record))]
    if record.notes:
        items = join(element("li", note) for note in record.notes)
        parts.append(paragraph("Not everything in the folder could be read:") + element("ul", items))  # type: ignore[arg-type]
    return section("provenance", "Provenance", *parts, _config(record))


def _facts(record: Record) -> list[list[object]]:
    created = next((e for e in record.events if e.event == "created"), None)
    last = record.events[-1] if record.events else None
    rows: list[list[object]] = [["robot", record.robot if record.campaign else "unknown"]]
    if created:
        rows += [["created", created.time], ["seed", _code(created.facts.get("seed", "–"))]]
        rows += [
            [key, _code(value)] for key, value in created.facts.items() if key == "preset" or "version" in key
        ]
    if last:
        rows += [
            ["last event", f"{last.event}, {last.time}"],
            ["configuration then (sha256)", _code(last.config_sha256)],
        ]
    rows.append(["events in the journal", f"{len(record.events)}"])
    rows += [["report drawn with", f"etude {_version('etude')}, Python {platform.python_version()}"]]
    return rows


def _code(value: Any) -> Html:
    return element("code", value)


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "of unknown version"


def _config(record: Record) -> Html:
    path = record.folder / "campaign.toml"
    if not path.is_file():
        return missing("campaign.toml is missing.")
    content = path.read_text(encoding="utf-8", errors="replace")
    return element("details", element("summary", "campaign.toml"), element("pre", element("code", content)))
