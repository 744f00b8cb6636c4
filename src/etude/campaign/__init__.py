"""A campaign folder and what is done with it: the only circle, through files."""

PUBLIC = ("create", "simulation", "training")
"""Modules that may be used from outside."""
