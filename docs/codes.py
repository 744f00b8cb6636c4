"""The page of codes, from the table of sentences: `python docs/codes.py` writes docs/reference/codes.md."""

from __future__ import annotations

from enum import EnumType
from pathlib import Path
from string import Formatter

from etude.codes import SENTENCES, Alert, NextStep, OfFile, Phrase, Refusal, Stop, Warn

PAGE = Path(__file__).parent / "reference" / "codes.md"
HEAD = """# Codes

Alerts, warnings, refusals and verdicts are values of `etude.codes.Notice`: a code, fields, and the code of a
next step. Programs read the code and the fields. Sentences are for people, and their words may change.

```json
{"code": "logs_missing", "fields": {"logs": 1}, "next_step": null, "step": "",
 "sentence": "1 more log before a stop rule applies"}
```

Per cent are parts of 1 in the fields. `docs/codes.py` writes this page from the table in `etude.codes`.
"""
SECTIONS: dict[EnumType, tuple[str, str]] = {
    Alert: (
        "Alerts",
        "`alerts` of `etude status --json`, and the warnings `too_little_motion` and `one_trajectory`.",
    ),
    Warn: ("Warnings", "`warnings` of `etude tell --json`, of `etude ask --json` and of `certificate.json`."),
    OfFile: ("Files", "`problems`, `edited` and `proved_otherwise` of `etude status --json`."),
    Refusal: ("Refusals", "`refused` of `etude promote --json`."),
    Stop: (
        "Stop verdicts",
        "`verdict` of `etude status --json`. Its `harm` is the notice that forbids use of the model.",
    ),
    Phrase: ("Phrases", "Notices that stand in a field of another one."),
    NextStep: ("Next steps", "`next_step` of a notice; its fields are those of the notice."),
}


def plain(sentence: str) -> tuple[list[str], str]:
    """Names of the fields, and the sentence with these in italics."""
    parts = [(text, name) for text, name, _, _ in Formatter().parse(sentence)]
    names = list(dict.fromkeys(name for _, name in parts if name))
    return names, "".join(f"{text}{f'*{name}*' if name else ''}" for text, name in parts)


def page() -> str:
    """The page as Markdown."""
    lines = [HEAD]
    for kind, (title, where) in SECTIONS.items():
        lines += [f"## {title}", "", where, "", "| code | fields | sentence |", "|---|---|---|"]
        for code in kind:
            names, sentence = plain(SENTENCES[code])
            lines.append(f"| `{code}` | {', '.join(f'`{name}`' for name in names)} | {sentence} |")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
