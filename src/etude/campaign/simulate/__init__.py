"""A campaign with a simulated robot in place of the real one."""

PUBLIC = ("create", "loop", "simulation")
"""Modules that may be used from outside."""
