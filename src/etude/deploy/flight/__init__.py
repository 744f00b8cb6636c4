"""A vehicle's model beside an autopilot's own feedback: the C, what feeds it set-points, and the glue."""

PUBLIC = ("target",)
"""Modules that may be used from outside."""
