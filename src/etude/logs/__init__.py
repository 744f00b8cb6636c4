"""From a file to a Log: readers, columns, units, the doctor, alignment, and the steps of every recipe."""

PUBLIC = ()
"""Modules that may be used from outside."""
