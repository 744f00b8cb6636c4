"""A campaign folder and what is done with it: the only circle, through files."""

PUBLIC = ("create",)
"""Modules that may be used from outside."""
