"""From a log file to the record: reading, questions, repeats, change of the robot."""

PUBLIC = ("questions",)
"""Modules that may be used from outside."""
