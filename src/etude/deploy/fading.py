"""What exported commands are outside of what was learned, in words: people should know it before they run
them.
"""

from __future__ import annotations

from etude.models.model import LearnedModel
from etude.models.parts import is_physical


def fading(model: LearnedModel) -> str:
    """Where commands go there, in a sentence."""
    used = [c for c in model.candidates if c.weights.any() and is_physical(c)]
    physical = {j for c in used for j, weight in zip(c.commands, c.weights, strict=True) if weight}
    bare = [name for j, name in enumerate(model.commands) if j not in physical]
    if not bare:
        return "where the model knows no more than before any data its commands are those of physics alone."
    whose = "every command goes" if len(bare) == len(model.commands) else f"those of {', '.join(bare)} go"
    return (
        f"where the model knows no more than before any data {whose} to 0, since no physics stand behind: "
        "nothing but your feedback holds the robot there."
    )
