"""Design of a recording of several segments, each conditioned on the segments before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from etude.design.candidates import ClearPoseSource, ReachablePoses, Source
from etude.design.config import DesignConfig
from etude.design.latents import Latent
from etude.design.objective import MOTIONS
from etude.design.solve import Design, design, variance_removed
from etude.errors import UnsafeTrajectoryError
from etude.limits.certificate import certify
from etude.limits.lead_ins import at_rest
from etude.progress import counted
from etude.protocols import Family, Inputs, Limit, Model, Physics, Trajectory
from etude.trajectories.chain import chained
from etude.types import Array

Approaches = Callable[[Trajectory, Array], tuple[Trajectory, Trajectory] | None]
"""Function of a kind: (motion, pose) -> motion from the pose to its start, and from its end back."""

HURRIED = (0.55, 0.65, 0.75, 0.85, 1.0)
"""Fractions of a link's duration that are tried. Approaches are slow, since they may begin at any pose."""
TRIES = 2
"""Number of designs of a segment away from home, as long as no straight motion from home reaches it."""


@dataclass(frozen=True, eq=False)
class DesignedChain:
    """A recording, and the designs of its segments in order.

    Attributes:
        trajectory: the chain; a single segment is not chained. segments: one design each.
        dropped: number of segments that were not found, or that no certified link reaches; the recording is
            shorter by these.
    """

    trajectory: Trajectory
    segments: tuple[Design, ...]
    dropped: int = 0

    @property
    def status(self) -> str:
        """The sentences of all designs."""
        if len(self.segments) == 1:
            return self.segments[0].status + dropped_sentence(self.dropped)
        values = ", ".join(f"{segment.value:.4g}" for segment in self.segments)
        how = f"{len(self.segments)} segments, each given those before it"
        return f"{how}: {self.segments[0].criterion} {values}.{dropped_sentence(self.dropped)}"

    @property
    def variance_removed(self) -> float:
        """Forecast fraction of the reference variance that the recording removes, mean over commands."""
        return variance_removed(self.segments[0].deviation_before, self.segments[-1].deviation_after)


def design_chain(
    family: Family,
    limits: Sequence[Limit],
    home: Array,
    inputs: Inputs,
    model: Model | Sequence[Latent],
    config: DesignConfig,
    rng: np.random.Generator,
    tasks: Sequence[Trajectory] = (),
    *,
    count: int,
    approaches: Approaches,
    standing_in: Sequence[Trajectory] = (),
    given: Sequence[Trajectory] = (),
    rate: float = 0.0,
    physics: Mapping[str, Physics] | None = None,
    roam: ReachablePoses | None = None,
) -> DesignedChain:
    """`count` segments of `family`, chained; other arguments and errors as `solve.design`.

    Segment i is designed given the planned samples of the segments before it. Their measured values are not
    needed, since a variance does not depend on them.
    """
    source: Source | ClearPoseSource = Source(family, tuple(limits), home, config.sampler)
    if roam is not None:
        source = ClearPoseSource.of(family, tuple(limits), roam, config.sampler)
    if not standing_in or roam is not None:  # the given ones are about home
        standing_in = [*standing_in, *(drawn.trajectory for drawn in source.typical(rng, MOTIONS))]
    designs: list[Design] = []
    for _ in counted(range(count)):
        before = [*given, *(segment.trajectory for segment in designs)]
        design_next = partial(
            design,
            *(family, limits, home, inputs, model, config, rng, tasks),
            standing_in=standing_in,
            given=before,
            rate=rate,
            physics=physics,
            roam=roam,
        )
        leads = (
            None if roam is None else partial(can_be_linked, approaches=approaches, limits=limits, home=home)
        )
        segment = _segment(design_next, leads, needed=not designs)
        if segment is None:
            break
        designs.append(segment)
        if roam is not None:
            roam = replace(roam, visited=roam.visited.adding([segment.trajectory]))
    segments = [segment.trajectory for segment in designs]
    order = list(range(len(designs))) if roam is None else nearest_order(segments, approaches, home)
    trajectory, linked = linked_chain([segments[i] for i in order], approaches, limits, home)
    return DesignedChain(trajectory, tuple(designs[i] for i in sorted(order[:linked])), count - linked)


def _segment(
    design_next: Callable[[], Design], leads: Callable[[Trajectory], bool] | None, *, needed: bool
) -> Design | None:
    """A designed segment that a straight motion `leads` to; if none of `TRIES` is, the last of them.

    None where no motion is proved: the segments found so far make a shorter recording.

    Raises:
        UnsafeTrajectoryError: no motion is proved, and one is `needed`.
    """
    segment: Design | None = None
    for again in range(TRIES):
        try:
            segment = design_next()
        except UnsafeTrajectoryError:
            if needed and segment is None:
                raise
            return segment
        if leads is None or again == TRIES - 1 or leads(segment.trajectory):
            break
    return segment


def can_be_linked(segment: Trajectory, approaches: Approaches, limits: Sequence[Limit], home: Array) -> bool:
    """Whether the straight motions from home to a segment and back are proved; then it can be linked."""
    links = approaches(segment, home)
    return links is not None and all(certify(part, limits).ok for part in links)


def nearest_order(segments: Sequence[Trajectory], approaches: Approaches, home: Array) -> list[int]:
    """An order of the segments with short links between them: the next one is always the nearest.

    Their joint information does not depend on the order, and links cost robot time without information.
    """
    left, at, order = list(range(len(segments))), home, []
    while left:
        far = []
        for i in left:
            links = approaches(segments[i], at)
            far.append(np.inf if links is None else links[0].duration)
        order.append(left.pop(int(np.argmin(far))))
        last = segments[order[-1]]
        at = last.motion(np.array([last.duration]), 1).orders[0, 0]
    return order


def linked_chain(
    segments: Sequence[Trajectory], approaches: Approaches, limits: Sequence[Limit], home: Array
) -> tuple[Trajectory, int]:
    """The chain of segments with certified links, and its number of segments: it ends where no link exists.

    A link is the fastest straight motion that is proved; where that leaves the limits, the motion via home.
    """
    if len(segments) > 1:  # links lead from rest to rest
        segments = [at_rest(segment, limits) for segment in segments]
    links: list[tuple[Trajectory, ...]] = []
    for before, after in pairwise(segments):
        link = _link(before, after, approaches, limits, home)
        if link is None:
            break
        links.append(link)
    linked = len(links) + 1
    return chained(segments[:linked], links), linked


def dropped_sentence(dropped: int) -> str:
    """Sentence on the number of segments that were left out."""
    return f" Segments without a certified motion or approach were dropped: {dropped}." if dropped else ""


def _link(
    before: Trajectory, after: Trajectory, approaches: Approaches, limits: Sequence[Limit], home: Array
) -> tuple[Trajectory, ...] | None:
    end = before.motion(np.array([before.duration]), 1).orders[0, 0]
    straight, back, there = approaches(after, end), approaches(before, home), approaches(after, home)
    tried: list[tuple[Trajectory, ...]] = [] if straight is None else [(straight[0],)]
    tried += [] if back is None or there is None else [(back[1], there[0])]
    for link in tried:
        for factor in HURRIED:
            hurried = tuple(part.slowed(factor) for part in link)
            if all(certify(part, limits).ok for part in hurried):
                return hurried
    return None
