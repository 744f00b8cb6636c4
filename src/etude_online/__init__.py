"""Learning while the robot runs: a learner for each command, a guard, a controller of all."""

PUBLIC = ("guard_effort", "learner", "model")
"""Modules that may be used from outside."""
