"""etude run"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from etude.cli.outcome import Common, Folder, Outcome, Say, opened, table, to_json
from etude.errors import typed

if TYPE_CHECKING:
    from typing import TextIO

    from etude.campaign.record.folder import Campaign
    from etude.campaign.run.campaign_run import RunOptions, RunResult
    from etude.campaign.run.robot_session import OnSample


@dataclass(frozen=True, kw_only=True)
class RunRobot(Common):
    """Run the whole loop on a robot: it MOVES.

    Exit code 3: a recording cannot be used; 4: no safe motion, or the robot refuses it; 6: the robot has
    changed; 7: the robot or the supervisor stopped it; 8: the link was lost; 130: interrupted, and at rest.
    """

    prints: ClassVar[bool] = True
    folder: Folder
    on: str = ""
    """The driver: NAME, NAME:ADDRESS, module:factory or file.py:factory (docs/run.md). Default: the driver of
    run.toml."""
    rounds: int | None = None
    """Largest number of motions. Default: until the stop rule fires."""
    yes: bool = False
    """Do not ask for the word move. Only for simulations."""
    dry_run: bool = False
    """Do everything except the motion: show what is missing, plan the first motion and the approach, ask the
    robot whether it accepts them."""
    resume: bool = False
    """Continue after a motion whose end is unknown. Look first where the robot is."""
    identity: str = ""
    """The robot's identity, if it differs from the earlier one although the robot is the same."""
    feedback: bool = False
    """Run training motions with feedback alone, although the robot accepts learned commands."""
    view: bool = False
    """Show the planned motion and the measured robot in a browser on this machine."""
    heartbeat: Path | None = None
    """A dead-man switch: the motion is stopped if this file is not touched for a second."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.run.campaign_run import run_campaign
        from etude.campaign.run.run_settings import driver_of, read_settings

        out = sys.stdout
        with redirect_stdout(sys.stderr):  # a driver may print
            campaign = opened(self.folder)
            settings = read_settings(campaign, self.on)
            options = self._options(settings.on, settings.defaults)
            printer = _EventPrinter(out if self.json else None, say)
            player, person = driver_of(campaign, settings), self._person(say)
            with self._view(printer) as put_sample:
                result = run_campaign(
                    campaign, player, person, options, say=say, tell_event=printer, seen=put_sample
                )
            report = "" if self.dry_run else _report(campaign, say)
            view = _draw_motion(campaign, result, say)
        written = {"report": report, "view": view}
        return Outcome("\n".join(_lines(campaign, result, [report, view])), {**_data(result), **written}, 0)

    @contextmanager
    def _view(self, printer: _EventPrinter) -> Iterator[OnSample]:
        """Receiver of the samples: the view, or nothing without --view."""
        if not self.view:
            yield lambda _, __, ___: None
            return
        from etude.report.run_view import RunView

        with RunView(self.folder) as view:
            printer.show = view.show
            printer("view", {"address": view.address})
            if not self.json:
                view.open()
            yield view.put

    def _person(self, say: Say) -> TerminalUser:
        from etude.errors import UsageError

        if self.heartbeat is not None and not self.heartbeat.is_file():
            raise UsageError(
                "there is no such file",
                where=f"--heartbeat {self.heartbeat}",
                next_step="First start the program that touches this file at least once a second.",
            )
        return TerminalUser(say, asks=not self.json, heartbeat=self.heartbeat)

    def _options(self, on: str, defaults: Any) -> RunOptions:
        from etude.campaign.run.campaign_run import RunOptions
        from etude.errors import UsageError

        rounds = defaults.rounds if self.rounds is None else self.rounds
        if rounds < 0 or self.rounds == 0:
            raise UsageError(f"the number of rounds must be 1 or more, not {rounds}")
        return RunOptions(
            on=on,
            rounds=rounds,
            yes=self.yes,
            dry=self.dry_run,
            resume=self.resume,
            identity=self.identity,
            learned=defaults.learned and not self.feedback,
            confirm=defaults.confirm,
            promote=defaults.promote,
        )


BEAT_S, LOOKED_S = 1.0, 0.05
"""s without a touch that stop a motion; s between two looks at the file."""


@dataclass
class TerminalUser:
    """The person at this terminal.

    Attributes:
        asks: whether anybody is there to type. heartbeat: a file that is touched while all is well.
    """

    say: Say
    asks: bool = True
    heartbeat: Path | None = None
    looked: float = 0.0
    well: bool = True

    def agrees(self, sentences: Sequence[str], word: str) -> bool:
        """Shows them, and waits for the word."""
        for sentence in sentences:
            self.say(sentence)
        if not self.asks:
            return False
        self.say(f"Is the workspace clear? Type {word} to start the motion:")
        return sys.stdin.readline().strip() == word

    def alive(self) -> bool:
        """Whether the file, if there is one, was touched of late; else Ctrl-C is how a person stops it."""
        now = time.monotonic()
        if self.heartbeat is not None and now - self.looked >= LOOKED_S:
            self.looked = now
            try:
                self.well = time.time() - self.heartbeat.stat().st_mtime < BEAT_S
            except OSError:
                self.well = False
        return self.well


@dataclass
class _EventPrinter:
    """Printer of events: lines of JSON on stdout, or one status line per second for people."""

    out: TextIO | None
    say: Say
    show: Callable[[int], None] = lambda _: None

    def __call__(self, event: str, fields: Mapping[str, Any]) -> None:
        if event == "planned":
            self.show(fields["number"])
        elif self.out is not None:
            print(to_json({"event": event, **fields}), file=self.out, flush=True)
        elif event == "view":
            self.say(f"The motion is shown on this machine: {fields['address']}")
        elif event == "status" and fields["at"] is not None:
            worst = max(fields["worst_error"], default=0.0)
            self.say(
                f"{fields['part']} {fields['number']}: {fields['at']:.0f} of {fields['of']:.0f} s, "
                f"worst error {worst:.3g}"
            )


def _report(campaign: Campaign, say: Say) -> str:
    from etude.report.build import build_report

    say("Drawing the report.")
    return str(build_report(campaign.path))


def _draw_motion(campaign: Campaign, result: RunResult, say: Say) -> str:
    """Path of the page of a dry run's first motion; "" without a motion or without a drawing."""
    from etude.errors import UsageError
    from etude.report.space import write_view

    if result.planned is None:
        return ""
    say("Drawing the motion.")
    try:
        return str(write_view(campaign.path, result.planned, result.approach)[0])
    except UsageError as error:
        say(f"The motion is not drawn: {error.fact}. {error.next_step}")
        return ""


def _lines(campaign: Campaign, result: RunResult, written: Sequence[str]) -> list[str]:
    unit = {"rad": "deg"}.get(campaign.channel(campaign.kind.path).units[0], "m")
    rows = [
        [f"motion {one.number}", one.control, *(f"{error:.3f}" for error in one.error)]
        for one in result.rounds
    ]
    if result.confirmed is not None:
        rows += [
            [f"confirm {result.confirmed['number']}", name, *map(_format_error, result.confirmed[name])]
            for name in ("without", "with")
        ]
    lines = [table([f"mean error, {unit}", "", *campaign.axes], rows, keys=2)] if rows else []
    lines += [f"Ended: {result.why}.", *result.notes]
    if result.robot_seconds:
        lines.append(f"The robot moved for {result.robot_seconds:.0f} s and waited for {result.stood:.0f} s.")
    if result.promotion is not None:
        lines += _promotion(result, campaign)
    return [*lines, *(f"Written: {path}" for path in written if path)]


def _format_error(error: float | None) -> str:
    return "-" if error is None else f"{error:.3f}"


def _promotion(result: RunResult, campaign: Campaign) -> list[str]:
    assert result.promotion is not None
    model = f"The model of log {result.promotion.number}"
    if result.promotion.promoted:
        return [f"{model} is in use now. Next: etude export {typed(campaign.path)} --to c"]
    why = " ".join(f"{one.sentence[:1].upper()}{one.sentence[1:]}." for one in result.promotion.refused)
    return [f"{model} is not promoted. {why}"]


def _data(result: RunResult) -> dict[str, Any]:
    promotion = result.promotion
    return {
        "rounds": [asdict(one) for one in result.rounds],
        "why": result.why,
        "robot_seconds": result.robot_seconds,
        "stood_seconds": result.stood,
        "confirmed": result.confirmed,
        "promoted": promotion is not None and promotion.promoted,
        "not_promoted": [] if promotion is None else [one.facts() for one in promotion.refused],
        "notes": list(result.notes),
        "planned": result.planned,
    }
