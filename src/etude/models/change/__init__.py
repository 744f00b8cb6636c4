"""Has the robot changed? Evidence in new logs, its onset and its diagnosis."""

PUBLIC = ("change_detection", "diagnosis", "evidence")
"""Modules that may be used from outside."""
