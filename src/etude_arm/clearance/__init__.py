"""Clearance of a robot from itself and its surroundings, proved for all times."""
