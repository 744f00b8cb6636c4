"""Learning while the robot runs: a learner and a guard for each command, a controller of all."""

PUBLIC = ("learner", "model")
"""Modules that may be used from outside."""
