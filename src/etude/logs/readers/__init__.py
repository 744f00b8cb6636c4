"""From files to tables of raw columns: one module a format."""

PUBLIC = ("frames", "log_file", "registry")
"""Modules that may be used from outside."""
