"""promote and rollback: selection of the deployed model, and the evidence for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from etude.campaign.record.deployed_model import check_pinned, pin, promoted_model
from etude.campaign.record.events import Promoted, RolledBack
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.record.journal import MODEL, jsonable
from etude.campaign.record.state import State
from etude.campaign.record.stored_models import LEFT_OUT, check_model, groups_of, ingested_samples
from etude.codes import Notice, Phrase, Refusal
from etude.errors import DataError, UsageError, typed
from etude.models.accuracy import (
    LEAST_COVERED,
    ErrorRatio,
    by_segment,
    compared,
    coverage,
    uncalibrated,
)
from etude.models.config import LEAST_SEGMENTS
from etude.models.data.fit_data import in_order, score_target
from etude.models.learned_model import LearnedModel
from etude.models.selection.model_selection import CONSTANT, CrossValidationResiduals, read_residuals
from etude.storage import sha256_of
from etude.types import Array, Samples

WORDS = {
    "identified": "identified physics",
    "nominal": "the model file's physics",
    "linear": "linear regression",
    CONSTANT: "a constant command",
}
"""Names in sentences of the structures that a model is compared with."""


@dataclass(frozen=True)
class Promotion:
    """Result of a request to promote a model.

    Attributes:
        number: of the last log in its training. sha256: of its file.
        promoted: it is deployed now. repeated: it was already deployed. forced: against the data.
        compared: with physics alone and, unless it is the first, with the deployed model.
        narrow, wide: (J,) fractions of held-out commands inside the 50 % and 95 % intervals; None if unknown.
        refused: reasons against the promotion.
    """

    number: int
    sha256: str
    promoted: bool
    repeated: bool = False
    forced: bool = False
    compared: tuple[ErrorRatio, ...] = ()
    narrow: tuple[float | None, ...] = ()
    wide: tuple[float | None, ...] = ()
    refused: tuple[Notice, ...] = ()


def promote(
    campaign: Campaign, *, force: bool = False, reason: str = "", say: Say = lambda _: None
) -> Promotion:
    """Deploys the newest model if held-out motion shows that it is better; an event in the journal.

    The model must beat physics alone and the deployed model, on segments that neither was trained on. A model
    that is physics alone must beat its predecessor. The intervals must cover the errors; see
    docs/promote_watch.md.

    Args:
        campaign: the folder.
        force: deploy the model against the data; the event holds the `reason`.
        reason: required with `force`.
        say: receives one sentence per step.

    Raises:
        UsageError: nothing was learned, a file was changed, or `force` has no reason.
        DataError: the held-out data cannot be read, or the model is of an earlier version and has none.
    """
    if force and not reason.strip():
        raise UsageError(
            "a forced promotion needs a reason", where="--force", next_step='Add --reason "...".'
        )
    with campaign.writing():
        state = campaign.state()
        if not state.trained:
            raise UsageError(
                "nothing has been learned yet", where=str(campaign.path), next_step="Ingest a log first."
            )
        check_model(campaign, state)
        number = state.trained[-1].number
        path = campaign.model_folder(number) / MODEL
        digest = sha256_of(path)
        if state.promoted and state.promoted[-1][1].sha256 == digest:
            if force:  # its copy was altered: the original is whole
                pin(campaign, path)
            check_pinned(campaign, *state.promoted[-1])
            return Promotion(number, digest, True, repeated=True)
        promotion = _compare_models(campaign, state, number, digest, force, say)
        if promotion.promoted:
            copy, digest = pin(campaign, path)
            fact = replace(_recorded(promotion, reason), sha256=digest, logs=_learned_logs(state))
            campaign.commit(fact, number, [copy])
        return promotion


def rollback(campaign: Campaign, *, reason: str = "") -> tuple[int, int]:
    """Deploys the previous model again; returns the numbers of the replaced and of the deployed model.

    Nothing is deleted: the rollback is an event, and the replaced model can be promoted again.

    Raises:
        UsageError: no earlier model exists, or its file is missing or was changed.
    """
    with campaign.writing():
        promoted = campaign.state().promoted
        if len(promoted) < 2:
            what = "nothing was promoted yet" if not promoted else "no model was in use before this one"
            another = "another model, after training on more logs" if promoted else "one"
            raise UsageError(
                what,
                where=str(campaign.path),
                next_step=f"Promote {another}: etude promote {typed(campaign.path)}.",
            )
        (number, left), (before, back) = promoted[-1], promoted[-2]
        check_pinned(campaign, before, back)
        campaign.commit(RolledBack(sha256=left.sha256, to=back.sha256, reason=reason), number)
        return number, before


def _compare_models(
    campaign: Campaign, state: State, number: int, digest: str, force: bool, say: Say
) -> Promotion:
    """The comparisons and the decision; with `force` also where comparisons are impossible."""
    try:
        left_out = read_residuals(campaign.model_folder(number) / LEFT_OUT)
        comparisons = _comparisons(campaign, state, left_out, say)
    except (DataError, UsageError) as error:
        if not force:
            raise
        why = Notice(Refusal.NOT_COMPARED, {"why": error.fact})
        return Promotion(number, digest, True, forced=True, refused=(why,))
    narrow, wide = coverage(left_out.error, left_out.variance)
    calibrated = state.newest is None or state.newest.calibrated
    refused = (*_reasons(comparisons), *_misfits(campaign.command.parts, wide, calibrated))
    parts = jsonable(narrow), jsonable(wide)
    return Promotion(
        number,
        digest,
        force or not refused,
        False,
        bool(refused) and force,
        tuple(comparisons),
        *parts,
        refused,
    )


def is_undecided(campaign: Campaign) -> bool:
    """Whether held-out motion decides neither for nor against the newest model, and more of it could; False
    where nothing can be compared, as `promote` then says.
    """
    state = campaign.state()
    if not state.trained:
        return False
    folder = campaign.model_folder(state.trained[-1].number)
    if state.promoted and state.promoted[-1][1].sha256 == sha256_of(folder / MODEL):
        return False
    try:
        comparisons = _comparisons(campaign, state, read_residuals(folder / LEFT_OUT))
    except (DataError, UsageError):
        return False
    return any(one.decision == "not decided" for one in comparisons)


def _comparisons(
    campaign: Campaign, state: State, left_out: CrossValidationResiduals, say: Say = lambda _: None
) -> list[ErrorRatio]:
    """With physics alone and, unless it is the first, with the deployed model."""
    comparisons = [_with_physics(left_out)]
    if state.promoted:
        say("Comparing with the model in use.")
        comparisons.append(_with_deployed_model(campaign, state, left_out))
    return comparisons


def _with_physics(left_out: CrossValidationResiduals) -> ErrorRatio:
    segments = np.unique(left_out.group).tolist()
    both = (by_segment(e, left_out.group, segments) for e in (left_out.error, left_out.physics))
    return compared(WORDS[left_out.structure], *both)


def _with_deployed_model(campaign: Campaign, state: State, left_out: CrossValidationResiduals) -> ErrorRatio:
    """Comparison with the deployed model, on segments of logs that it was not trained on."""
    number, promoted = state.promoted[-1]
    before = promoted_model(campaign, number, promoted)
    logs = _newest_logs(state)
    samples = in_order(ingested_samples(campaign, logs)).take(left_out.rows)
    if not np.array_equal(samples.group, left_out.group):
        raise DataError(
            "the logs give other samples than at the time of training",
            where=str(campaign.path),
            next_step="campaign.toml was edited since: ingest another log, and the model is trained on "
            "all logs again.",
        )
    fresh = _fresh_logs(campaign, state, logs, set(promoted.logs))
    error = _errors(before, samples, score_target(samples, campaign.config.model))
    # the same samples, as a paired comparison needs
    both = np.isfinite(left_out.error) & np.isfinite(error)
    newest, deployed = (np.where(both, e, np.nan) for e in (left_out.error, error))
    pair = (by_segment(e, left_out.group, fresh) for e in (newest, deployed))
    return compared(f"the model in use, of log {number}", *pair)


def _errors(model: LearnedModel, samples: Samples, command: Array) -> Array:
    try:
        return np.asarray(command - model.posterior(samples.log)[0])
    except KeyError as error:
        raise DataError(
            f"the logs lack an input of the model in use ({error.args[0]})",
            next_step="Tell logs that have that column, as the logs of the model in use have.",
        ) from error


def _fresh_logs(campaign: Campaign, state: State, logs: Sequence[int], hashes: set[str]) -> list[int]:
    """Groups of segments that contain no part of a log in the deployed model."""
    groups = groups_of(campaign, logs)
    trained_groups = {
        group
        for number, segments in groups.items()
        for _, group in segments
        if (ingested := state.rounds[number].ingested) is not None and ingested.sha256 in hashes
    }
    return sorted({group for segments in groups.values() for _, group in segments} - trained_groups)


def _newest_logs(state: State) -> Sequence[int]:
    """Numbers of the logs in the newest model."""
    return state.newest.logs if state.newest else ()


def _learned_logs(state: State) -> tuple[str, ...]:
    """Hashes of the logs in the newest model."""
    logs = _newest_logs(state)
    return tuple(sorted(r.ingested.sha256 for r in state.ingested if r.ingested and r.number in logs))


def _reasons(comparisons: Sequence[ErrorRatio]) -> list[Notice]:
    """Reasons against the model, from held-out errors.

    Physics is among the model's candidates, so that the model may be equal to it. But it must be better than
    the model in use.
    """
    out = []
    for place, one in enumerate(comparisons):
        fields: dict[str, Any] = {"against": one.against, "segments": one.segments}
        errors = {"ratio": one.ratio, "lower": one.lower, "upper": one.upper}
        if one.segments < LEAST_SEGMENTS:
            out.append(Notice(Refusal.NOT_DECIDED, {**fields, "needed": LEAST_SEGMENTS}))
        elif one.decision == "not decided":
            out.append(Notice(Refusal.NOT_YET_BETTER, {**fields, **errors}))
        elif one.decision == "not better" or (place and one.decision == "level"):
            out.append(Notice(Refusal.NOT_BETTER, {**fields, **errors}))
    return out


def _misfits(commands: Sequence[str], wide: Array, calibrated: bool) -> list[Notice]:
    """Notices on intervals that are narrower than the errors."""
    out = [] if calibrated else [Notice(Refusal.NOT_CALIBRATED)]
    low = uncalibrated(wide)
    missed = tuple(Notice(Phrase.COVERAGE, {"output": commands[j], "part": float(wide[j])}) for j in low)
    fields = {"coverage": missed, "least": LEAST_COVERED}
    return [*out, Notice(Refusal.INTERVALS_MISS, fields)] if missed else out


def _recorded(promotion: Promotion, reason: str) -> Promoted:
    rows = [asdict(one) | {"decision": one.decision} for one in promotion.compared]
    for row in rows:
        row |= {name: jsonable([row[name]])[0] for name in ("ratio", "lower", "upper")}
        row["by_command"] = jsonable(row["by_command"])
    return Promoted(
        sha256=promotion.sha256,
        forced=promotion.forced,
        compared=tuple(rows),
        narrow=promotion.narrow,
        wide=promotion.wide,
        refused=promotion.refused,
        reason=reason,
    )
