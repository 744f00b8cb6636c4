"""What leaves for the robot: trajectory files and the command expected along them."""

PUBLIC = ()
"""Modules that may be used from outside."""
