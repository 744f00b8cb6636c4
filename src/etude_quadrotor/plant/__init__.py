"""Simulated vehicles, with their controllers."""

PUBLIC = ("disturbance", "robot", "simulated")
"""Modules that may be used from outside."""
