"""What may not be exceeded: limits, the set of motions inside them, samplers of it, certificates."""

PUBLIC = ("certificate", "feasible", "samplers", "tracking")
"""Modules that may be used from outside."""
