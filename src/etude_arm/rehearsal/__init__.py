"""Simulation of any robot of joints from its own model file."""
