"""What exported commands are outside of what was learned, in words: people should know it before they run
them.
"""

from __future__ import annotations

import numpy as np

from etude.models.model import LearnedModel
from etude.models.selection.member_prediction import level_of, physics_behind


def fading(model: LearnedModel) -> str:
    """Where commands go there, in a sentence."""
    used = [(c, physics_behind(c, model.candidates)) for c in model.candidates if c.weights.any()]
    known = [c for c, mean in used if mean is not None]
    physical = {j for c in known for j, weight in zip(c.commands, c.weights, strict=True) if weight}
    bare = [name for j, name in enumerate(model.commands) if j not in physical]
    if not bare:
        return "where the model knows no more than before any data its commands are those of physics alone."
    level = np.zeros(len(model.commands))
    for c, mean in used:
        if mean is None:
            level[list(c.commands)] += c.weights * level_of(c)
    told = ", ".join(f"{name} {level[model.commands.index(name)]:.3g}" for name in bare)
    return (
        "where the model knows no more than before any data no physics stand behind these commands, and each "
        f"goes to a level, the part of its mean in training that was steady: {told}. Nothing but your "
        "feedback holds the robot there."
    )
