"""etude status"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etude.cli.outcome import Common, Folder, Outcome, Say, opened, table
from etude.codes import Warn
from etude.errors import UsageError, typed

NO_MATTER = 0.05
"""Part of the variance below which the choice of a motion is not worth a thought."""
LARGEST = 1000.0  # above it a score is told as one, not in digits
MEND = "Next: restore these files from a copy; a command that needs one of them states other repairs."
BASES = {
    "identified": "physics identified from the logs",
    "nominal": "physics of the description",
    "linear": "linear regression on the logs",
}
"""What a structure's mean is, in words."""
MIXED, SELECTED = "mixed", "selected now"
MIXED_MEANS = "mixed: several structures, each with its weight in each output."


@dataclass(frozen=True, kw_only=True)
class Status(Common):
    """Show how well the model predicts, and whether another trajectory is worth its robot time."""

    folder: Folder

    def run(self, say: Say) -> Outcome:
        from etude.campaign.evaluate.status import status

        try:
            campaign = opened(self.folder)
        except UsageError:
            for line in _journal_lines(self.folder):
                say(line)
            raise
        facts = status(campaign)
        return Outcome("\n".join(_lines(facts)), facts)


def _journal_lines(folder: Path) -> list[str]:
    """Lines from the journal alone, for a campaign that cannot be opened, as without its plug-in."""
    from etude.campaign.evaluate.status import status_without_robot

    facts = status_without_robot(folder)
    if facts is None:
        return []
    head = f"{facts['robot']} ({', '.join(facts['axes'])}), preset {facts['preset']}, seed {facts['seed']}"
    details = (*_trajectories(facts), *_deployed_model(facts), *_problems(facts))
    return [*_alerts(facts), head, *details, "More cannot be shown:"]


def _lines(facts: Mapping[str, Any]) -> list[str]:
    lines = [
        *_alerts(facts),
        f"{facts['robot']} ({', '.join(facts['axes'])}), preset {facts['preset']}, seed {facts['seed']}",
        *_trajectories(facts),
        *_held_out(facts),
        *_new_motion(facts),
        *_prequential(facts),
        *_mixed(facts),
        *_structure_lines(facts),
    ]
    lines += [*_deployed_model(facts), *_confirmed(facts)]
    if facts["calibration_factor"] is not None:
        factor = facts["calibration_factor"]
        lines.append(f"Calibration factor {factor:.2f} (z^2 of held-out logs; 1 is ideal).")
    lines += _forecast(facts)
    if facts["next_gain"] is not None:
        lines.append(
            f"The next trajectory is expected to remove {100 * facts['next_gain']:.0f} % of the remaining "
            "variance."
        )
    if facts["choice"] is not None and facts["choice"] < NO_MATTER:
        lines.append(
            f"The choice of the next motion no longer matters: the best leaves {100 * facts['choice']:.1f} "
            "% less variance than the median random one."
        )
    if facts["trajectories"]:
        verdict = facts["verdict"]
        go_on = "Go on: " if verdict["usable"] else "First repair the red findings. "
        lines.append(("Stop: " if verdict["stop"] else go_on) + verdict["reason"])
    lines += faults(facts["known_faults"])
    lines += [f"Look: {one['sentence']}. {one['step']}" for one in facts["proved_otherwise"]]
    lines += [f"Edited: {one['sentence']}. {one['step']}" for one in facts["edited"]]
    return [*lines, *_problems(facts)]


def _problems(facts: Mapping[str, Any]) -> list[str]:
    """Lines on damaged files."""
    return [*(f"Problem: {one['sentence']}." for one in facts["problems"]), *[MEND] * bool(facts["problems"])]


def _forecast(facts: Mapping[str, Any]) -> list[str]:
    """Line on the expected command error; unknown after one log, or after slow ones."""
    fraction, head = facts["forecast_fraction"], "Expected command error: "
    if facts["scored_log"] is None:
        return []
    if fraction is not None:
        share = (
            f"{100 * fraction:.2g} % of the limit" if fraction < 1.0 else "as large as the limit, or larger"
        )
        return [f"{head}{share} (worst axis, while it moves)."]
    slow = any(notice["code"] == Warn.SLOW_MOTION for notice in facts["alerts"])
    return [
        f"{head}unknown for faster motion."
        if slow
        else f"{head}unknown for other motion, because only one log was ingested."
    ]


def faults(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Lines on unsafe files of earlier versions, with the commands that replace them."""
    return [f"UNSAFE [{one['code']}]: {one['sentence']}Write it again: {one['command']}" for one in rows]


def _alerts(facts: Mapping[str, Any]) -> list[str]:
    """Lines on alerts, with the next steps."""
    lights = {"red": "RED", "yellow": "Look"}
    return [f"{lights[n['light']]}: {n['sentence']}. {n['step']}".rstrip() for n in facts["alerts"]]


def _trajectories(facts: Mapping[str, Any]) -> list[str]:
    if not facts["trajectories"]:
        return [f"No trajectory yet. Next: etude ask {typed(facts['folder'])}"]
    rows = [
        [
            str(t["number"]),
            t["standing"] + (" (no proposal)" if t["foreign"] else ""),
            "" if t["robot_seconds"] is None else f"{t['robot_seconds']:.1f} s",
            t["source"] or "",
        ]
        for t in facts["trajectories"]
    ]
    return [table(["trajectory", "state", "motion", "log"], rows)]


def _held_out(facts: Mapping[str, Any]) -> list[str]:
    held_out = facts["held_out"]
    if held_out is None:
        return []
    blocks = ", ".join(map(str, held_out["blocks"]))
    newest = held_out["number"] == facts["scored_log"]  # later logs have chosen since
    used = f" (selected now: {_in_use(facts)})" if newest and not facts["prequential"] else ""
    return [
        f"nMSE within log {held_out['number']}, blocks {blocks} of {held_out['of']} from the others{used}.",
        "Errors on other motions may be many times as large: ingest a second log.",
        _by_output(facts, _with_selected(facts, held_out["nmse"])),
        *_at_rest_scores(
            facts, *(_with_selected(facts, held_out.get(key) or {}) for key in ("nmse", "nmse_all"))
        ),
    ]


def _with_selected(facts: Mapping[str, Any], scores: Mapping[str, Any]) -> dict[str, Any]:
    """Scores by structure, with a row for the structures selected now, which later logs may have changed."""
    shown = {structure: values for structure, values in scores.items() if structure != MIXED}
    structures = facts["rungs"] or []
    if shown and len(set(structures)) > 1:
        none = [None] * len(structures)
        shown[SELECTED] = [shown.get(structure, none)[j] for j, structure in enumerate(structures)]
    return shown


def _new_motion(facts: Mapping[str, Any]) -> list[str]:
    """Lines on the scores of logs left out, which estimate the error on new motions."""
    scores = facts["new_motion"]
    if scores is None:
        return []
    rows = {"in use": scores["used"].get("nmse") or [], "linear regression": scores.get("linear") or []}
    return [
        f"nMSE on new motion, each of {scores['logs']} motions predicted from the others:",
        _by_output(facts, rows),
    ]


def _mixed(facts: Mapping[str, Any]) -> list[str]:
    return [MIXED_MEANS] * (MIXED in facts["prequential"])


def _structure_lines(facts: Mapping[str, Any]) -> list[str]:
    """Lines on the structure of each output's model, after the first log."""
    structures = facts["rungs"]
    if not structures or facts["prequential"]:
        return []
    by_structure = {
        structure: [o for o, r in zip(facts["outputs"], structures, strict=True) if r == structure]
        for structure in dict.fromkeys(structures)
    }
    return [
        f"{', '.join(outputs)}: {_describe_structure(structure)}."
        for structure, outputs in by_structure.items()
    ]


def _describe_structure(structure: str) -> str:
    base, plus, _ = structure.partition("+")
    physics = BASES.get(base, f"{base} physics")
    if base == "gp":
        return "a Gaussian process alone, which predicts nothing outside the visited states"
    if plus:
        return f"{physics}, with a Gaussian process at the visited states; physics alone elsewhere"
    return f"{physics} alone"


def _prequential(facts: Mapping[str, Any]) -> list[str]:
    scores = {kind: score.get("nmse") or [] for kind, score in facts["prequential"].items()}
    if not scores:
        return []
    return [
        f"nMSE of log {facts['scored_log']}, predicted before it was learned"
        f" (selected now: {_in_use(facts)}):",
        _by_output(facts, scores),
        *_at_rest_scores(
            facts, scores, {kind: score.get("nmse_all") for kind, score in facts["prequential"].items()}
        ),
    ]


def _deployed_model(facts: Mapping[str, Any]) -> list[str]:
    used = facts["in_use"]
    if used is None:
        return []
    forced = ", by force" if used["forced"] else ""
    newer = "" if used["number"] == used["newest"] else f"; newest: of log {used['newest']}, not promoted"
    return [f"Promoted: the model of log {used['number']} ({used['sha256'][:12]}){forced}{newer}."]


def _confirmed(facts: Mapping[str, Any]) -> list[str]:
    """Tables of tracking errors on confirmation motions, with the forecast."""
    from etude.campaign.record.confirmation import SHOWN, in_words

    lines = []
    for one in facts["confirmed"]:
        if one["units"] is None:
            continue
        none = [None] * len(one["axes"])
        unit = one["units"][0] if len(set(one["units"])) == 1 else "own units"
        rows = [[name, *map(in_words, one[key] or none)] for key, name in SHOWN.items()]
        lines += [
            f"Trajectory {one['number']}, never used for training: mean tracking error ({unit}), feedforward",
            table(["", *one["axes"]], rows),
        ]
    return lines


def _at_rest_scores(
    facts: Mapping[str, Any], moving: Mapping[str, Any], every: Mapping[str, Any]
) -> list[str]:
    """The table with the samples of joints at rest, if there are any."""
    scores = {kind: values for kind, values in every.items() if values}
    if not scores or all(values == moving.get(kind) for kind, values in scores.items()):
        return []
    return ["The same, including joints at rest while others move:", _by_output(facts, scores)]


def _in_use(facts: Mapping[str, Any]) -> str:
    """Structure of all outputs, or one for each."""
    structures = facts["rungs"] or [facts["chosen"]]
    if len(set(structures)) == 1:
        return str(structures[0])
    return ", ".join(
        f"{output} {structure}" for output, structure in zip(facts["outputs"], structures, strict=True)
    )


def _by_output(facts: Mapping[str, Any], scores: Mapping[str, Any]) -> str:
    rows = [
        [kind, *("-" if value is None else _figure(value) for value in values)]
        for kind, values in scores.items()
    ]
    return table(["model", *facts["outputs"]], rows)


def _figure(value: float) -> str:
    """A score as text; above `LARGEST`, only a bound."""
    return f"{value:.4f}" if abs(value) < LARGEST else f"over {LARGEST:g}"
