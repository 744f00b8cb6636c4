"""A campaign folder and what is done with it: the only circle, through files."""

PUBLIC = (
    "config",
    "config_file",
    "controls",
    "create",
    "folder",
    "foretold",
    "journal",
    "learn",
    "loop",
    "questions",
    "rounds",
    "simulate",
    "stored",
)
"""Modules that may be used from outside."""
