"""Simulated robots: pure dynamics with their parameters in data files, behind one interface."""
