"""The loop that the robot closes by itself: approach, careful steps, motion, log, next motion; then the
motion that confirms, and promotion.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from etude.abilities import SupportsAgreement
from etude.campaign.deployment.promote import Promotion, is_undecided, promote
from etude.campaign.evaluate.confirm import ask_to_confirm
from etude.campaign.evaluate.stopping import seen_by_the_rule, stop_verdict
from etude.campaign.ingest.recordings import is_even
from etude.campaign.ingest.tell import take, tell
from etude.campaign.propose.ask import ask
from etude.campaign.record.confirmation import RUNS, confirmed
from etude.campaign.record.controls import FEEDBACK, LEARNED, asked_under
from etude.campaign.record.deployed_model import model_of_sha256
from etude.campaign.record.events import Abandoned, Ingested, MotionEnded, RunBegan, RunEnded
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.record.stored_models import newest_model
from etude.campaign.run.certified_motions import (
    CertifiedMotion,
    Learned,
    careful_motion,
    holding,
    proposal_motion,
    require_accepted,
    transfers_of,
)
from etude.campaign.run.next_proposal import NextProposal
from etude.campaign.run.preconditions import open_points, require_none
from etude.campaign.run.robot_session import (
    OnSample,
    Result,
    RobotSession,
    Tell,
    after_loss,
    held_on_signals,
    only_one,
)
from etude.campaign.run.run_history import next_step, pending_recordings
from etude.drivers import About, Person, Player, read_recording
from etude.errors import DataError, EtudeError, LinkLost, RobotStopped, StopRuleReached, UsageError, typed
from etude.models.learned_model import LearnedModel
from etude.protocols import Trajectory

WORD = "move"
"""What a person types before anything moves."""
MOST_ROUNDS = 50
"""Of one command, whatever the stop rule says."""
MOST_AFTER_STOP = 3
"""Motions after the stop rule has fired, while held-out motion does not decide on the model."""
LATE = 0.01
"""Part of the cycles of a motion that may come late without a word."""


@dataclass(frozen=True)
class RunOptions:
    """Options of a run of a campaign.

    Attributes:
        on: the driver, as it was named. rounds: motions at most; 0: until the stop rule fires.
        yes: agreed beforehand, to a simulation. dry: everything but motion.
        resume: a person has looked at where an unfinished motion left the robot.
        identity: that the person says the robot has now.
        learned, confirm, promote: see `run_settings.RunDefaults`.
    """

    on: str = ""
    rounds: int = 0
    yes: bool = False
    dry: bool = False
    resume: bool = False
    identity: str = ""
    learned: bool = True
    confirm: bool = True
    promote: bool = True


@dataclass(frozen=True)
class RoundRun:
    """Figures of one motion for training.

    Attributes:
        number: of the proposal. control: control of the run.
        error: (k,) mean |measured - asked|, deg or the path's unit. worst: (k,) the largest, rad (m).
    """

    number: int
    control: str
    error: tuple[float, ...]
    worst: tuple[float | None, ...]


@dataclass(frozen=True)
class RunResult:
    """Result of a run.

    Attributes:
        rounds: motions for training. why: reason of its end, a sentence.
        robot_seconds: of motion, with transfers and careful steps. stood: s that the robot stood and waited.
        confirmed: result of the confirmation motion, as in `status`; None without one.
        promotion: outcome for the newest model; None if it was not requested. notes: further sentences.
        planned: number of the first motion of a dry run; None: it is a confirmation motion, or it ran.
        approach: from the robot's pose to that motion; None: it stands there.
    """

    rounds: tuple[RoundRun, ...] = ()
    why: str = ""
    robot_seconds: float = 0.0
    stood: float = 0.0
    confirmed: Mapping[str, Any] | None = None
    promotion: Promotion | None = None
    notes: tuple[str, ...] = ()
    planned: int | None = None
    approach: Trajectory | None = None


def run_campaign(
    campaign: Campaign,
    player: Player,
    person: Person,
    options: RunOptions,
    *,
    say: Say = lambda _: None,
    tell_event: Tell = lambda _, __: None,
    seen: OnSample = lambda _, __, ___: None,
) -> RunResult:
    """Run the campaign on a robot in closed loop; see docs/run.md.

    Args:
        campaign: the folder. player: the robot, not connected yet. person: who agrees, and who can stop it.
        say: receives one sentence per step. tell_event: what happened, by name. seen: each sample.

    Raises:
        UsageError: something is open, or a person did not agree; nothing moved.
        UnsafeTrajectoryError: no motion or way is proved, or the robot refuses it. DataError: a recording
            cannot be used. RobotStopped, LinkLost, KeyboardInterrupt: see `RobotSession.play`.
    """
    with connected(
        campaign,
        player,
        person,
        resume=options.resume,
        identity=options.identity,
        tell=tell_event,
        on=options.on,
        seen=seen,
    ) as session:
        return close_loop(session, options, say)


@contextlib.contextmanager
def connected(
    campaign: Campaign,
    player: Player,
    person: Person,
    *,
    resume: bool = False,
    identity: str = "",
    tell: Tell = lambda _, __: None,
    on: str = "",
    seen: OnSample = lambda _, __, ___: None,
) -> Iterator[RobotSession]:
    """The robot, connected, once nothing is open that blocks it; nothing moves. Errors as `run_campaign`.

    on: the driver's name, for next steps. seen: receives each sample of a motion.
    """
    about = player.about()
    with only_one(campaign, about):
        _nothing_open(campaign, about, resume, identity)
        with _open_player(player), held_on_signals(player):
            # some robots tell what they are set to carry only now
            about = player.about()
            waived = _nothing_open(campaign, about, resume, identity)
            if waived and isinstance(campaign.spec, SupportsAgreement):
                campaign = replace(campaign, spec=campaign.spec.agreed())
            yield RobotSession(campaign, player, about, person, tell, waived=waived, on=on, seen=seen)


def _nothing_open(campaign: Campaign, about: About, resume: bool, identity: str) -> tuple[str, ...]:
    """Sentences that a simulation waives. UsageError: another point is open."""
    points = open_points(campaign, about, resume=resume, identity=identity)
    return tuple(require_none(campaign, points, simulated=not about.real))


@contextlib.contextmanager
def _open_player(player: Player) -> Iterator[None]:
    """`with player`. What the driver raises is the driver's fault, and hides no other error.

    Raises:
        LinkLost: it could not connect. RobotStopped: it failed to let the robot go.
    """
    try:
        player.__enter__()
    except EtudeError:
        raise
    except Exception as error:
        fact = f"the driver could not connect: {type(error).__name__}: {error}"
        raise LinkLost(fact, next_step="Nothing moved. Check its address and its power.") from error
    try:
        yield
    except BaseException as problem:
        with contextlib.suppress(Exception):
            player.__exit__(type(problem), problem, problem.__traceback__)
        raise
    try:
        player.__exit__(None, None, None)
    except Exception as error:
        fact = f"the driver failed to release the robot: {type(error).__name__}: {error}"
        raise RobotStopped(
            fact, next_step="Look at the robot: it is unknown whether it is at rest."
        ) from error


def close_loop(session: RobotSession, options: RunOptions, say: Say = lambda _: None) -> RunResult:
    """As `run_campaign`, for a robot that is already connected."""
    loop = _Loop(session.campaign, session, options, say)
    first, fired = loop.first()
    sentences = what_will_happen(session, options, first)
    if first is not None:
        session.tell("planned", {"number": first.number, "speed": first.speed, "control": first.control})
    if options.dry:
        number = None if first is None else first.number
        return RunResult(
            why="nothing was moved: --dry-run", notes=tuple(sentences), planned=number, approach=loop.approach
        )
    _require_agreed(session.person, session.about, options, sentences)
    with _journaled(session.campaign, session.about, options):
        return loop.closed(first, fired)


@contextlib.contextmanager
def _journaled(campaign: Campaign, about: About, options: RunOptions) -> Iterator[None]:
    """Record in the journal that a run began, and how it ended."""
    facts = {
        name: value for name, value in vars(about).items() if isinstance(value, str | bool | int | float)
    }
    began = RunBegan(
        driver=options.on,
        robot=about.name,
        identity=about.identity,
        real=about.real,
        agreed="--yes" if options.yes else "typed",
        told=facts,
    )
    with campaign.writing():
        campaign.commit(began)
    try:
        yield
    except BaseException as problem:
        code, why = 130 if isinstance(problem, KeyboardInterrupt) else 1, type(problem).__name__
        if isinstance(problem, EtudeError):
            code, why = problem.exit_code, problem.fact
        with contextlib.suppress(EtudeError), campaign.writing():
            campaign.commit(RunEnded(why=why, exit_code=code))
        raise
    with campaign.writing():
        campaign.commit(RunEnded(why="done"))


def what_will_happen(session: RobotSession, options: RunOptions, first: CertifiedMotion | None) -> list[str]:
    """Sentences to be read before agreement: robot, place, duration, stop conditions, assumptions."""
    campaign, about, pose = session.campaign, session.about, session.pose()
    where = ", ".join(f"{axis} {value:.3g}" for axis, value in zip(campaign.axes, pose.tolist(), strict=True))
    rounds = (
        f"{options.rounds} motion{'s' * (options.rounds > 1)}"
        if options.rounds
        else "motions until the stop rule fires"
    )
    rounds = rounds if first is not None else "only the confirmation motion, because the stop rule has fired"
    real = "It is a real robot: keep a hand on its emergency stop." if about.real else "It is a simulation."
    return [
        f"{about.name} ({about.identity}) will move: {rounds}, with approaches and returns. {real}",
        f"It is at {where}.",
        f"If this program dies, {after_loss(about)}.",
        *([] if first is None else _of_first(campaign, first)),
        *session.waived,
    ]


def _of_first(campaign: Campaign, first: CertifiedMotion) -> list[str]:
    step, last = "the beginning of " * first.first, first.trajectory.duration
    whole = proposal_motion(campaign, first.number, first.control).trajectory
    q = whole.motion(np.linspace(0.0, whole.duration, 1000), 1).orders[0]
    rows = zip(campaign.axes, q.min(axis=0), q.max(axis=0), strict=True)
    ranges = ", ".join(f"{axis} in {low:.2f}..{high:.2f}" for axis, low, high in rows)
    return [
        f"First: {step}motion {first.number} at {first.speed} % of its speed, {last:.0f} s, "
        f"under {first.control}.",
        f"Motion {first.number} moves {ranges}.",
    ]


def _require_agreed(person: Person, about: About, options: RunOptions, sentences: list[str]) -> None:
    if options.yes:
        if about.real:
            raise UsageError(
                f"{about.name} is a real robot, so a person has to agree",
                where="--yes",
                next_step=f"Leave out --yes, and type {WORD}.",
            )
        return
    if not person.agrees(sentences, WORD):
        raise UsageError(
            "the motion was not confirmed; nothing moved",
            next_step=f"Run the command again, and type the whole word {WORD}.",
        )


@dataclass(eq=False)
class _Loop:
    """The loop over a campaign and a connected robot."""

    campaign: Campaign
    session: RobotSession
    options: RunOptions
    say: Say
    rounds: list[RoundRun] = field(default_factory=list)
    approach: Trajectory | None = None  # to the first motion
    after_stop: int = 0  # motions asked for since the stop rule has fired

    def first(self) -> tuple[CertifiedMotion | None, str]:
        """The first motion, proved and accepted; None with the reason if the stop rule has fired.

        Nothing moves. Recordings that an earlier run did not ingest are ingested first, so that no motion
        runs twice.
        """
        for number, path in pending_recordings(self.campaign):
            self._ingest(number, path)
        try:
            motion = self._motion_at_step(self._next_number(self._propose))
        except StopRuleReached as fired:
            return None, fired.fact
        pose = self.session.pose()
        approach = transfers_of(self.campaign, motion, pose).approach
        self.approach = None if approach is None else approach.trajectory
        for segment in (approach, motion):
            if segment is not None:
                planned = segment.for_driver(self.campaign, self.session.about)
                require_accepted(self.session.player.check(planned), segment)
        return motion, ""

    def closed(self, first: CertifiedMotion | None, why: str) -> RunResult:
        """Run all rounds and the confirmation motion, then promote."""
        number = None if first is None else first.number
        most = self.options.rounds or MOST_ROUNDS
        while number is not None:
            number, why = self._run_round(number, last=len(self.rounds) + 1 >= most)
        self.say(f"{why[:1].upper()}{why[1:]}.")
        confirmation = (
            self._run_confirmation()
            if self.options.confirm
            else (None, "no confirmation motion was requested")
        )
        promotion, reasons = self._promote(*confirmation)
        return RunResult(
            tuple(self.rounds),
            why,
            self.session.seconds,
            self.session.stood,
            confirmation[0],
            promotion,
            reasons,
        )

    @property
    def control(self) -> str:
        """The control for which the next motion is proposed."""
        return LEARNED if self._takes_learned and self.campaign.state().learned else FEEDBACK

    @property
    def _takes_learned(self) -> bool:
        is_configured = self.options.learned and self.campaign.config.tracking.control == LEARNED
        return is_configured and LEARNED in self.session.about.controls

    def _propose(self) -> int:
        control = "" if self.campaign.state().proposals else self.control
        return ask(self.campaign, control=control, say=self.say).number

    def _next_number(self, propose: Callable[[], int]) -> int:
        """Number of the next proposal. StopRuleReached: another one is not worth its robot time."""
        try:
            return propose()
        except StopRuleReached as fired:
            return self._after_stop(fired)

    def _after_stop(self, fired: StopRuleReached) -> int:
        """Number of one more proposal, if its log may decide on the model; otherwise raise `fired`."""
        rule = stop_verdict(
            seen_by_the_rule(self.campaign, self.campaign.state()), self.campaign.config.stop
        ).rule
        may_go_on = self.options.promote and rule != "budget" and self.after_stop < MOST_AFTER_STOP
        if not may_go_on or not is_undecided(self.campaign):
            raise fired
        self.after_stop += 1
        self.say("Held-out motion does not show yet whether the model is better, so another motion follows.")
        return ask(self.campaign, go_on=True, control=self._onward_control, say=self.say).number

    def _run_round(self, number: int, last: bool) -> tuple[int | None, str]:
        """Run one motion after its careful steps; the number of the next one, or None and the reason."""
        try:
            result = self._run_whole(number, self._control_of(number))
        except RobotStopped:
            self._abandon(number)
            raise
        self._ingest_round(number, result)
        ours = not self.session.about.virtual
        onward = NextProposal(self.campaign, self._onward_control, beside=ours, say=self.say)
        changed = bool(self.campaign.state().awaiting_answer)
        try:
            self._return_home(number, (lambda: None) if last or changed else onward.begin)
            if changed:
                raise RobotChanged(self.campaign)
            if last:
                learn(self.campaign, self.say)
                return None, f"{len(self.rounds)} rounds are done"
            return self._next_number(onward.number), ""
        except StopRuleReached as fired:
            return None, fired.fact
        finally:
            onward.end()

    @property
    def _onward_control(self) -> str:
        """The control of the next motion, once the ingested log is learned."""
        return LEARNED if self._takes_learned else FEEDBACK

    def _control_of(self, number: int) -> str:
        """The control for which a proposal was made; learned if both are possible."""
        controls = asked_under(self.campaign.round(number).asked) or (FEEDBACK,)
        return LEARNED if LEARNED in controls and self._takes_learned else controls[0]

    def _run_whole(self, number: int, control: str, model: LearnedModel | None = None) -> Result:
        """Run the whole motion at full speed, after the careful steps that its control still needs."""
        while True:
            motion = self._motion_at_step(number, control)
            result = self._run_motion(self._with_command(motion, model))
            if not motion.first:
                return result

    def _motion_at_step(self, number: int, control: str = "") -> CertifiedMotion:
        """The motion at the speed allowed for its control so far; each speed has its own proof."""
        motion = proposal_motion(self.campaign, number, control or self._control_of(number))
        step = next_step(self.campaign.events(), motion.control)
        return (careful_motion(self.campaign, motion, step.speed) or motion) if step.first else motion

    def _with_command(self, motion: CertifiedMotion, model: LearnedModel | None = None) -> CertifiedMotion:
        """The motion with the learned command, if its control is learned."""
        if motion.control != LEARNED:
            return motion
        model = model or newest_model(self.campaign, self.campaign.state())
        learned = Learned.along(self.campaign, model, motion, self.session.about)
        return replace(motion, learned=learned)

    def _run_motion(self, motion: CertifiedMotion) -> Result:
        """Run the approach and the motion; a learned command fades in or out on the approach."""
        pose = self.session.pose()
        level = 1.0 if motion.learned is not None else 0.0
        approach = transfers_of(self.campaign, motion, pose).approach
        if approach is None and level != self.session.level:
            approach = holding(motion, pose)
        if approach is not None:
            self.session.play(self._fade_command(approach, level))
        what = "the beginning of motion" if motion.first else "motion"
        self.say(f"Running {what} {motion.number} at {motion.speed} %, under {motion.control}.")
        result = self.session.play(motion)
        late, cycles = result.fact.late, len(result.recording.t)
        if late > LATE * cycles:
            self.say(
                f"{late} of {cycles} cycles were late, so the robot followed uneven set-points. Reduce the "
                "load of this computer or the driver's rate."
            )
        return result

    def _fade_command(self, transfer: CertifiedMotion, level: float) -> CertifiedMotion:
        """The motion with a learned command that fades from the present level to the next one."""
        if not level and not self.session.level:
            return transfer
        learned = self._with_command(replace(transfer, control=LEARNED))
        return replace(learned, fade=(self.session.level, level))

    def _return_home(self, number: int, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Return home while the next motion is computed."""
        motion = proposal_motion(self.campaign, number, self._control_of(number))
        home = np.asarray(self.campaign.kind.home(self.campaign.spec), dtype=float)
        back = transfers_of(self.campaign, motion, home).back
        if back is None:
            meanwhile()
        else:
            self.session.play(self._fade_command(back, self.session.level), meanwhile)

    def _ingest_round(self, number: int, result: Result) -> None:
        """Ingest the recording as the log of its proposal, and note its figures."""
        self._ingest(number, result.path)
        self.rounds.append(self._figures(number, result))
        self.session.tell("taken_in", asdict(self.rounds[-1]))

    def _ingest(self, number: int, path: Path) -> None:
        """Ingest a recording as the log of its proposal; the next `ask` learns it."""
        try:
            with self.campaign.writing():
                result = take(self.campaign, path, number)
        except DataError as error:
            if is_even(read_recording(path)):  # else there is nothing to answer
                command = f"etude tell {typed(self.campaign.path)} {typed(path)}"
                error.next_step += f" Answer with: {command}. Without that file the motion is run again."
            raise
        for sentence in result.repairs:
            self.say(f"{path.name}: {sentence}")

    def _abandon(self, number: int) -> None:
        """Abandon a whole motion that was stopped; its log is used up to the stop."""
        last = next(e.fact for e in reversed(self.campaign.events()) if isinstance(e.fact, MotionEnded))
        if last.part != "motion" or last.first:
            return
        with self.campaign.writing():
            with contextlib.suppress(DataError):
                take(self.campaign, self.campaign.path / last.recording)
            self.campaign.commit(Abandoned(), number)
        self.say(f"Motion {number} ended early; its log is used up to there.")

    def _figures(self, number: int, result: Result) -> RoundRun:
        recording = result.recording
        inside = (recording.t >= recording.began) & (recording.t - recording.began <= recording.reached)
        error = np.nanmean(np.abs(recording.q - recording.asked)[inside], axis=0)[self.session.columns]
        units = self.campaign.channel(self.campaign.kind.path).units
        shown = [math.degrees(e) if u == "rad" else e for e, u in zip(error.tolist(), units, strict=True)]
        return RoundRun(number, result.fact.control, tuple(shown), result.fact.worst_error)

    def _run_confirmation(self) -> tuple[Mapping[str, Any] | None, str]:
        """Result of the confirmation motion; None with the reason if there is none."""
        if not self._takes_learned:
            return None, "the robot accepts no learned commands, so there was no confirmation"
        number = ask_to_confirm(self.campaign, say=self.say).number
        proposal = self.campaign.round(number).asked
        model = None if proposal is None else model_of_sha256(self.campaign, proposal.model_sha256)
        for name, control in zip(RUNS, (FEEDBACK, LEARNED), strict=True):
            if name in self.campaign.round(number).runs:
                continue
            result = self._run_whole(number, control, model)
            tell(self.campaign, result.path, number=number, confirm=name, say=self.say)
        self._return_home(number)
        return confirmed(self.campaign, self.campaign.round(number)), ""

    def _promote(
        self, confirmation: Mapping[str, Any] | None, why: str
    ) -> tuple[Promotion | None, tuple[str, ...]]:
        """Promote the newest model if it is better; otherwise sentences with the reason."""
        reasons = (f"{why[:1].upper()}{why[1:]}.",) if why else ()
        if not self.options.promote:
            return None, reasons
        if confirmation is not None and (worse := _reason_against(confirmation)):
            return None, (*reasons, worse)
        return promote(self.campaign, say=self.say), reasons


def learn(campaign: Campaign, say: Say) -> None:
    """Learn the ingested logs without a new proposal."""
    from etude.campaign.training import learn_pending

    with campaign.writing():
        learn_pending(campaign, say=say)


def _reason_against(confirmation: Mapping[str, Any]) -> str:
    """Reason not to promote a model: it made the confirmation motion worse. "": it did not."""
    without, with_model = (np.array(confirmation[name], dtype=float) for name in RUNS)
    if not np.nansum(with_model) > np.nansum(without):
        return ""
    return (
        "The model was not promoted: on the confirmation motion the mean error was "
        f"{np.nanmean(with_model):.3g} {confirmation['units'][0]} with it and {np.nanmean(without):.3g} "
        "without."
    )


class RobotChanged(EtudeError):
    """The newest recording differs from the robot that the model was trained on."""

    exit_code = 6

    def __init__(self, campaign: Campaign) -> None:
        waiting = campaign.state().awaiting_answer[0]
        findings = waiting.ingested.findings if isinstance(waiting.ingested, Ingested) else ()
        why = " ".join(one.sentence for one in findings).rstrip(".")
        step = f"etude tell {typed(campaign.path)} --changed new (or forget, or same), then run again."
        fact = f"the robot has changed: log {waiting.number}: {why}"
        super().__init__(fact, where=str(campaign.path), next_step=step)
