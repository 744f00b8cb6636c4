"""Feedforward from a model, and the closed loop that uses it."""
