"""Inverse models of a vehicle from its physics, and its drag."""

PUBLIC = ("vehicle_inverse",)
"""Modules that may be used from outside."""
