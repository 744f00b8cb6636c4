"""Robots of joints: arms, gantries, legs with a fixed base."""

PUBLIC = ("adaptive_control", "controller", "preprocessing", "spec")
"""Modules that may be used from outside."""
