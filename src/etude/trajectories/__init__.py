"""Trajectories as pure functions of time, with limits proved for all times. See docs/architecture.md."""
