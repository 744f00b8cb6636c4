"""Trajectories as pure functions of time, and the families that motions are proposed from."""

PUBLIC = ("chain", "family", "fourier", "json_text", "moves")
"""Modules that may be used from outside."""
