"""Simulated arms: the plant behind `Kind.robot`."""
