"""Robots of joints: arms, gantries, legs with a fixed base."""

PUBLIC = ("adaptive", "controller", "recipe", "spec")
"""Modules that may be used from outside."""
