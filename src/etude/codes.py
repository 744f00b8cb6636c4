"""Codes of alerts, verdicts, warnings and next steps, with their fields and the one table of their sentences.

Code decides on codes alone. A sentence is made where it is shown, by `Notice.sentence`, and never read back.
docs/reference/codes.md lists every code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from string import Formatter
from typing import Any, Literal

from etude.errors import typed

Light = Literal["red", "yellow", ""]
"""Of an alert: red, do not use what it is about; yellow, look at it."""


class Alert(StrEnum):
    """Alerts, which are shown before any figure."""

    MOTION_OPEN = "motion_open"
    LOG_FINDING = "log_finding"
    NARROW_INTERVALS = "narrow_intervals"
    NEVER_MOVED = "never_moved"
    CONSTANT_AS_GOOD = "constant_as_good"
    LINEAR_BETTER = "linear_better"
    WORSE_THAN_FEEDBACK = "worse_than_feedback"
    TEST_WORSE = "test_worse"


class Warn(StrEnum):
    """Warnings about a training or a proposed motion."""

    TOO_LITTLE_MOTION = "too_little_motion"
    ONE_TRAJECTORY = "one_trajectory"
    SLOW_MOTION = "slow_motion"
    LINEAR_ALONE = "linear_alone"
    LINEAR_BELOW = "linear_below"
    PERHAPS_CHANCE = "perhaps_chance"
    INPUTS_MISSING = "inputs_missing"
    NO_BLOCKS = "no_blocks"
    SOME_TEACH = "some_teach"
    TWO_ROBOTS = "two_robots"
    BEYOND_LIMITS = "beyond_limits"
    HARDLY_MOVES = "hardly_moves"
    TEACHES_LITTLE = "teaches_little"
    TEACHES_LITTLE_HELD = "teaches_little_held"
    STATED = "stated"


class OfFile(StrEnum):
    """Problems of the files in a campaign's folder."""

    MISSING = "file_missing"
    CHANGED = "file_changed"
    UNREADABLE = "file_unreadable"
    EDITED = "file_edited"
    EXPORT_EDITED = "export_edited"
    PROVED_BEFORE = "proved_before"


class Refusal(StrEnum):
    """Reasons why a model is not promoted."""

    NOT_COMPARED = "not_compared"
    NOT_DECIDED = "not_decided"
    NOT_YET_BETTER = "not_yet_better"
    NOT_BETTER = "not_better"
    NOT_CALIBRATED = "not_calibrated"
    INTERVALS_MISS = "intervals_miss"


class Stop(StrEnum):
    """Verdicts of the stop rules."""

    BUDGET_LOGS = "budget_logs"
    BUDGET_TIME = "budget_time"
    TOLERANCE = "tolerance"
    NOISE = "noise"
    GAIN = "gain"
    DOUBTED = "doubted"
    LOGS_MISSING = "logs_missing"
    OPEN = "open"


class Phrase(StrEnum):
    """Parts of sentences: values of fields that hold one of several phrases."""

    PREDICTED = "predicted"
    LEFT_OUT = "left_out"
    COVERAGE = "coverage"
    TAKES = "takes"
    LOW_COVERAGE = "low_coverage"
    STRUCTURE = "structure"
    STRUCTURE_THEN = "structure_then"
    LARGE_ERRORS = "large_errors"
    UNSETTLED = "unsettled"
    SLOW_LOGS = "slow_logs"
    OPEN_FORECAST = "open_forecast"
    OPEN_GAIN = "open_gain"
    GAIN_UNKNOWN = "gain_unknown"
    NO_RULE = "no_rule"


class NextStep(StrEnum):
    """Next steps: what to do about a notice. They use the notice's fields."""

    LOOK_AND_RESUME = "look_and_resume"
    OF_CHECK = "of_check"
    TELL_SUCH_MOTION = "tell_such_motion"
    MOVE_OUTPUT = "move_output"
    MOVE_JOINTS = "move_joints"
    TELL_OR_LINEAR = "tell_or_linear"
    TELL_TO_CHOOSE = "tell_to_choose"
    ASK_LIKE_IT = "ask_like_it"
    SEE_REPAIRS = "see_repairs"
    ASK_AGAIN = "ask_again"
    GIVE_UP = "give_up"
    TAKE_UP = "take_up"
    EXPORT_AGAIN = "export_again"
    TELL_ANOTHER = "tell_another"
    TELL_MOVING = "tell_moving"
    TELL_FASTER = "tell_faster"
    UNTELL_SIMULATED = "untell_simulated"


Code = Alert | Warn | OfFile | Refusal | Stop | Phrase

ERRED = "{command}: the held-out error of the process is {ratio:.3g} times that of linear regression"

SENTENCES: Mapping[Code | NextStep, str] = {
    Alert.MOTION_OPEN: "the {part} of proposal {number} was sent at {time}, and its end was not "
    "recorded: the robot may have moved",
    Alert.LOG_FINDING: "log {log}: {found}",
    Alert.NARROW_INTERVALS: "the model's intervals are too narrow: {where}, its 95 % intervals held "
    "{coverage}",
    Alert.NEVER_MOVED: "{outputs}: almost no motion in any log, so its model is not usable",
    Alert.CONSTANT_AS_GOOD: "{outputs}: {where}, a constant would have predicted as well",
    Alert.LINEAR_BETTER: "{outputs}: {where}, linear regression has a smaller error than {structure}",
    Alert.WORSE_THAN_FEEDBACK: "test {test}: with the model the error is {error:.3g} {unit}, without it "
    "{alone:.3g}",
    Alert.TEST_WORSE: "test {test} got worse with the last log: {before:.3g} to {error:.3g} {unit}",
    Warn.TOO_LITTLE_MOTION: "{commands}: too little motion in {seconds:.0f} s of logs, so the model is "
    "uncertain everywhere",
    Warn.ONE_TRAJECTORY: ERRED + ", but one trajectory is too little to select that instead",
    Warn.SLOW_MOTION: "{axes}: the logs reach at most {part:.0f %} of the speed of motions that the "
    "limits allow, so the error on faster motion is unknown",
    Warn.LINEAR_ALONE: ERRED + ", so linear regression alone predicts this command",
    Warn.LINEAR_BELOW: ERRED + ", so the process now learns the residual of linear regression",
    Warn.PERHAPS_CHANCE: ERRED + ", which may be chance",
    Warn.INPUTS_MISSING: "Inputs excluded from the model, because some logs lack them: {inputs: and }",
    Warn.NO_BLOCKS: "No blocks of log {log} were held out, because it cannot be learned alone: {why}",
    Warn.SOME_TEACH: "The model is trained on {some} of {all} logs: the newest and an even selection of "
    "the others. This bounds the training time",
    Warn.TWO_ROBOTS: "log {simulated} was simulated, log {real} is of the real robot: the model learns "
    "from two robots",
    Warn.BEYOND_LIMITS: "Beyond the stated {quantity} limits, by {source}: {beyond}. Not verified: "
    "whether the drives can deliver that",
    Warn.HARDLY_MOVES: "Almost no motion is possible: no joint moves through more than {part:.2g %} of "
    "its range. At home the distance of {pair} is {apart_mm:.2g} mm, too small for tracking errors "
    "and motion. Describe the shapes of these links more closely, or set another home in [search]",
    Warn.TEACHES_LITTLE: "A model learns almost nothing from this motion: no joint sweeps more than "
    "{part:.0f %} of its range",
    Warn.TEACHES_LITTLE_HELD: "A model learns almost nothing from this motion: no joint sweeps more than "
    "{part:.0f %} of its range. Blocked by: {held}",
    Warn.STATED: "{sentence}",
    OfFile.MISSING: "{file} is missing",
    OfFile.CHANGED: "{file} was changed after Étude stored it",
    OfFile.UNREADABLE: "{file} cannot be read ({why})",
    OfFile.EDITED: "{file} was edited after Étude last read it ({when})",
    OfFile.EXPORT_EDITED: "{file} was changed after the export, and may differ from the model",
    OfFile.PROVED_BEFORE: "{file} was certified before {changed: and } changed",
    Refusal.NOT_COMPARED: "not compared: {why}",
    Refusal.NOT_DECIDED: "no decision against {against}: {segments:|segment|segments} that neither model was "
    "trained on, but {needed} are needed",
    Refusal.NOT_YET_BETTER: "not yet better than {against}: errors {ratio:.3g} times as large (95 %: "
    "{lower:.3g} to {upper:.3g}, {segments:|segment|segments}), but more logs can decide",
    Refusal.NOT_BETTER: "not better than {against}: errors {ratio:.3g} times as large (95 %: {lower:.3g} to "
    "{upper:.3g}, {segments:|segment|segments})",
    Refusal.NOT_CALIBRATED: "too few trajectories were held out for its intervals to be calibrated",
    Refusal.INTERVALS_MISS: "its 95 % intervals hold {coverage} of held-out commands; at least {least:.0f %} "
    "are required",
    Stop.BUDGET_LOGS: "The budget of {logs:|log|logs} is used up",
    Stop.BUDGET_TIME: "The budget of {minutes:g} min of motion is used up",
    Stop.TOLERANCE: "The expected command error is {forecast:.2g %} of the command limit, within {goal:g %}",
    Stop.NOISE: "The remaining variance is below {fraction:g} of the noise variance on every axis",
    Stop.GAIN: "The next trajectory would remove less than {threshold:g %} of the remaining variance per "
    "minute of robot time",
    Stop.DOUBTED: "The expected command error is {forecast:.2g %} of the command limit, within {goal:g %}, "
    "but {doubt}",
    Stop.LOGS_MISSING: "{logs:|more log|more logs} before a stop rule applies",
    Stop.OPEN: "No stop rule applies yet: {open:; }",
    Phrase.PREDICTED: "on log {log}, predicted before it was learned",
    Phrase.LEFT_OUT: "on {logs} motions, each predicted from the others",
    Phrase.COVERAGE: "{output} {part:.0f %}",
    Phrase.TAKES: "{command} {most:.3g} {unit} of {limit:.3g}",
    Phrase.LOW_COVERAGE: "its 95 % intervals held only {part:.0f %} of an output's commands",
    Phrase.STRUCTURE: "{structure}",
    Phrase.STRUCTURE_THEN: "{structure}, selected then",
    Phrase.LARGE_ERRORS: "squared held-out errors are {factor:.1f} times the predicted variance, so this is "
    "not reliable",
    Phrase.SLOW_LOGS: "the logs contain slow motion only",
    Phrase.UNSETTLED: "the last log changed a length scale by a factor {factor:.1f}, so the model has "
    "not converged",
    Phrase.OPEN_FORECAST: "expected command error {forecast:.2g %} of the command limit (goal {goal:g %})",
    Phrase.OPEN_GAIN: "{rate:.2g %} of the remaining variance per minute (threshold {threshold:g %})",
    Phrase.GAIN_UNKNOWN: "etude ask computes what the next motion would add",
    Phrase.NO_RULE: "only the budget rule is active",
    NextStep.LOOK_AND_RESUME: "If the robot is at rest, look where it is; then: etude run {folder:typed} "
    "--on {driver:typed} --resume. No motion is repeated.",
    NextStep.OF_CHECK: "{step}",
    NextStep.TELL_SUCH_MOTION: "Do not use its deviations yet: ingest another log of a motion like those "
    "that the model is for.",
    NextStep.MOVE_OUTPUT: "Do not use this output yet: run the motion that etude ask writes, which moves "
    "it, and ingest that log.",
    NextStep.MOVE_JOINTS: "Do not use these outputs yet: move these joints more, and check the log.",
    NextStep.TELL_OR_LINEAR: 'Ingest another log; if the alert remains, set rung = "linear" in '
    "campaign.toml.",
    NextStep.TELL_TO_CHOOSE: "Ingest another log: it decides which structure is chosen for each output.",
    NextStep.ASK_LIKE_IT: "Do not use the model on such motions; record more motions with tasks like "
    "them (etude ask --tasks).",
    NextStep.SEE_REPAIRS: "Check that log's repairs; if the log is wrong, exclude it with etude untell.",
    NextStep.ASK_AGAIN: "Certify it again before you run it: etude ask {folder:typed}{options}",
    NextStep.GIVE_UP: "Do not run it; abandon it: etude abandon {folder:typed} {number}",
    NextStep.TAKE_UP: "The next ask or tell reads the edited file; ask also certifies an open motion "
    "again: etude ask {folder:typed}",
    NextStep.EXPORT_AGAIN: "Write it again: etude export {folder:typed} --to {target}{output}",
    NextStep.TELL_ANOTHER: "Ingest another one.",
    NextStep.TELL_MOVING: "Ingest another log that moves it.",
    NextStep.TELL_FASTER: "Ingest a log of faster motion.",
    NextStep.UNTELL_SIMULATED: "Exclude the simulated ones: etude untell {folder:typed} {newest}",
}
"""By code: no capital and no full stop where it may stand within a sentence."""

_CODES: Mapping[str, Code] = {str(code): code for code in SENTENCES if not isinstance(code, NextStep)}


@dataclass(frozen=True)
class Notice:
    """One message.

    Attributes:
        code: kind of the message.
        fields: its values: numbers, texts, notices, and tuples of these; SI units, ratios as parts of 1.
        next_step: what to do about it; None: nothing.
        light: severity of an alert.
    """

    code: Code
    fields: Mapping[str, Any] = field(default_factory=dict)
    next_step: NextStep | None = None
    light: Light = ""

    def __str__(self) -> str:
        """Sentence and next step as one."""
        step = self.step
        return f"{self.sentence}; {step[0].lower()}{step[1:]}" if step else f"{self.sentence}."

    @property
    def sentence(self) -> str:
        """For people, without a full stop."""
        return _WORDS.vformat(SENTENCES[self.code], (), self.fields)

    @property
    def step(self) -> str:
        """The next step as a sentence; "" without one."""
        return _WORDS.vformat(SENTENCES[self.next_step], (), self.fields) if self.next_step else ""

    def to_json(self) -> dict[str, Any]:
        """As JSON values, without those that equal their defaults."""
        entry = {
            "code": str(self.code),
            "fields": {name: _plain(value) for name, value in self.fields.items()},
        }
        entry |= {"next_step": str(self.next_step)} if self.next_step else {}
        return entry | ({"light": self.light} if self.light else {})

    @classmethod
    def from_json(cls, value: Any) -> Notice:
        """A notice from JSON values; a bare text becomes `Warn.STATED`. ValueError: it is no notice."""
        if isinstance(value, str):
            return cls(Warn.STATED, {"sentence": value.rstrip(".")})
        if not isinstance(value, dict) or value.get("code") not in _CODES:
            raise ValueError(f"{value!r} is no notice")
        step, light = value.get("next_step"), value.get("light", "")
        fields = {str(name): _read(one) for name, one in value.get("fields", {}).items()}
        return cls(_CODES[value["code"]], fields, NextStep(step) if step else None, light)

    def facts(self) -> dict[str, Any]:
        """For `--json`: code and fields, and the sentences."""
        step = str(self.next_step) if self.next_step else None
        return {**self.to_json(), "next_step": step, "sentence": self.sentence, "step": self.step}


def stated(notices: Sequence[str | Notice]) -> tuple[Notice, ...]:
    """Notices of a plug-in, which may return sentences in their place."""
    return tuple(one if isinstance(one, Notice) else Notice.from_json(one) for one in notices)


class _Words(Formatter):
    """`str.format` with more format specs: "typed" for a path in a command, " %" for parts of 1 in per cent,
    "|one|many" for a count; for a tuple, the text between its items.
    """

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Notice):
            return value.sentence
        if isinstance(value, tuple):
            return (format_spec or ", ").join(self.format_field(one, "") for one in value)
        if format_spec == "typed":
            return typed(value)
        if format_spec.endswith(" %"):
            return f"{format(100.0 * value, format_spec[:-2])} %"
        if format_spec.startswith("|"):
            _, one, many = format_spec.split("|")
            return f"{value} {one if value == 1 else many}"
        return format(value, format_spec)


_WORDS = _Words()


def _plain(value: Any) -> Any:
    if isinstance(value, Notice):
        return value.to_json()
    return [_plain(one) for one in value] if isinstance(value, tuple) else value


def _read(value: Any) -> Any:
    if isinstance(value, dict):
        return Notice.from_json(value)
    return tuple(_read(one) for one in value) if isinstance(value, list) else value
