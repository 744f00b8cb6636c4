"""From a file to a Log: readers, columns, units, the doctor, alignment, and the steps of every recipe."""

PUBLIC = ("frames", "log_file", "mapping", "read", "readers", "steps", "tracked")
"""Modules that may be used from outside."""
