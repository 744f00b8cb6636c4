"""Design of the next motion: criteria, reference states, one objective and one search."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.design.candidates import Source
    from etude.design.chain_design import design_chain, linked_chain
    from etude.design.config import DesignConfig
    from etude.design.criteria import (
        Criterion,
        Output,
        PlainBatch,
        Score,
        criterion_named,
        evaluate,
        ivr,
        mean_variance,
        needs_of,
        value_of,
    )
    from etude.design.latents import Latent, latents_of, of_parameters, prior_latents
    from etude.design.nonconvex_limits import NonconvexLimits
    from etude.design.objective import MOTIONS, Objective, reference_states
    from etude.design.solve import Design, design, design_objective, refine

__all__ = [
    "MOTIONS",
    "Criterion",
    "Design",
    "DesignConfig",
    "Latent",
    "NonconvexLimits",
    "Objective",
    "Output",
    "PlainBatch",
    "Score",
    "Source",
    "criterion_named",
    "design",
    "design_chain",
    "design_objective",
    "evaluate",
    "ivr",
    "latents_of",
    "linked_chain",
    "mean_variance",
    "needs_of",
    "of_parameters",
    "prior_latents",
    "reference_states",
    "refine",
    "value_of",
]
__getattr__, __dir__ = face(__name__)
