"""What was learned: one ladder of rungs for every kind of robot, its members, scores and store."""

PUBLIC = ("config", "model", "process", "score", "student_t", "trust")
"""Modules that may be used from outside."""
