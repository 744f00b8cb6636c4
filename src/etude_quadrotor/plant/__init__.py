"""Simulated vehicles, with their controllers."""
