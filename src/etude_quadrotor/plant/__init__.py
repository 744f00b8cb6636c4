"""Simulated vehicles, with their controllers."""

PUBLIC = ("robot", "simulated")
"""Modules that may be used from outside."""
