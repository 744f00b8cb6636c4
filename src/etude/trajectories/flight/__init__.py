"""Flights: attitude from motion, feasible sets, certificates."""
