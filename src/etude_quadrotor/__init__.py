"""Vehicles with four rotors: what they are, how they fly and what a model of them looks at."""

PUBLIC = ("controller", "flatness", "inputs", "kind", "recipe", "recorded", "spec", "voltages")
"""Modules that may be used from outside."""
