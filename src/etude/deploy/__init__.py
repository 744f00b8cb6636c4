"""What leaves for the robot: trajectory files and the command expected along them."""

PUBLIC = ("c99",)
"""Modules that may be used from outside."""
