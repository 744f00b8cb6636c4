"""Robots of joints: arms, gantries, legs with a fixed base."""
