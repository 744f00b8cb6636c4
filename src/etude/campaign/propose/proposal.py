"""What is asked next: designed from what was learned, or before any log from the limits alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.campaign.propose.motions import from_rest, reference_motions, segments_of, typical_motions, ways_of
from etude.campaign.propose.visited import roam_of
from etude.campaign.record.folder import Campaign, Say
from etude.design.latents import Latent
from etude.protocols import Inputs, Limit, Model, Trajectory

FIRST = {"scaled": "random, scaled to the limits", "uniform": "random, uniform on what is allowed"}
"""What a random first trajectory is, by the sampler that draws it."""


@dataclass(frozen=True, eq=False)
class Known:
    """What a design starts from: inputs, what is known of the robot, and whether that was learned."""

    inputs: Inputs
    model: Model | Sequence[Latent]
    learned: bool


def proposed(
    campaign: Campaign,
    model: Model | None,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory],
    open_ones: Sequence[Trajectory],
    limits: Sequence[Limit],
    say: Say,
) -> tuple[Trajectory, dict[str, Any]]:
    """The next recording, and the facts of how it was found.

    Before any log tasks are not looked at: a motion for them alone leaves the rest of the robot unknown.

    Args:
        model: the newest, None before any log.
        open_ones: proposals that wait for their logs: what they will tell is not asked for again.
        limits: less the margins of tracking.
    """
    known = _known(campaign, model)
    if known is None:
        found, facts = _random(campaign, rng, limits)
    else:
        what = "from what was learned" if known.learned else "from the limits alone"
        say(f"Designing the next trajectory {what}.")
        found, facts = _designed(campaign, known, rng, tasks if known.learned else (), open_ones, limits)
    return from_rest(campaign, found, limits), facts


def _known(campaign: Campaign, model: Model | None) -> Known | None:
    """None: nothing to design from, or nothing is to be."""
    from etude.design.latents import prior_latents

    if model is not None:
        return Known(model.inputs, model, True)
    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    if config.design.first == "random":
        return None
    inputs = kind.inputs(spec, config)
    latents = prior_latents(
        inputs, kind.expected(spec).limits, kind.limit(spec), config.model, campaign.command.parts
    )
    return None if latents is None else Known(inputs, latents, False)


def _random(
    campaign: Campaign, rng: np.random.Generator, limits: Sequence[Limit]
) -> tuple[Trajectory, dict[str, Any]]:
    """Random segments, chained."""
    from etude.design.chain import cut_short, linked

    family = campaign.kind.family(campaign.spec, campaign.config)
    count = segments_of(campaign, family)
    motions = typical_motions(campaign, rng, count, limits, grown=True)
    home = campaign.kind.home(campaign.spec)
    trajectory, kept = linked(motions, ways_of(campaign), limits, home)
    several = f"{kept} segments, " if kept > 1 else ""
    status = f"{several}{FIRST[campaign.config.design.sampler]}: nothing has been learned yet"
    return trajectory, {"status": status + cut_short(count - kept), "gain": None}


def _designed(
    campaign: Campaign,
    known: Known,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory],
    open_ones: Sequence[Trajectory],
    limits: Sequence[Limit],
) -> tuple[Trajectory, dict[str, Any]]:
    """The recording that teaches most, and the facts of its search."""
    from etude.design.chain import design_chain

    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    family = kind.family(spec, config)
    mixed = known.learned and config.design.reference == "mixed"
    found = design_chain(
        family,
        limits,
        kind.home(spec),
        known.inputs,
        known.model,
        config.design,
        rng,
        tasks,
        count=segments_of(campaign, family),
        ways=ways_of(campaign),
        standing_in=reference_motions(campaign, rng) if mixed else (),
        given=open_ones,
        rate=float(spec.rate),
        physics=kind.physics(spec, config),
        roam=roam_of(campaign, family, open_ones),
    )
    first, last = found.segments[0], found.segments[-1]
    facts = {
        "status": found.status if known.learned else f"from the limits alone: {found.status}",
        "gain": found.variance_removed if known.learned else None,
        "criterion": last.criterion,
        "value": last.value,
        "baseline_value": last.baseline,
        "choice": max((c for own in found.segments if (c := own.choice) is not None), default=None),
        "deviation_before": first.deviation_before.tolist(),
        "deviation_after": last.deviation_after.tolist(),
        "evaluations": sum(own.evaluations for own in found.segments),
        "seconds": sum(own.seconds for own in found.segments),
    }
    return found.trajectory, facts
