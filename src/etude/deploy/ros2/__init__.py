"""A model as a package of ROS 2: a chainable controller of ros2_control around its C."""

PUBLIC = ("target",)
"""Modules that may be used from outside."""
