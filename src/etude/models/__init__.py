"""What was learned: one ladder of rungs for every kind of robot, its members, scores and store."""

PUBLIC = (
    "cause",
    "changed",
    "config",
    "fit",
    "held_out",
    "judged",
    "ladder",
    "linear",
    "manner",
    "model",
    "process",
    "score",
    "student_t",
    "trust",
)
"""Modules that may be used from outside."""
