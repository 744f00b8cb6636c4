"""Trajectories as pure functions of time, and the families that motions are proposed from."""

PUBLIC = ("family", "fourier")
"""Modules that may be used from outside."""
