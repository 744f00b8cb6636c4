"""Inverse models of a vehicle from its physics, and its drag."""
