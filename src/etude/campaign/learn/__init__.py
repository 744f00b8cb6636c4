"""From the logs of the record to a model, and what error to expect of it."""

PUBLIC = ("training",)
"""Modules that may be used from outside."""
