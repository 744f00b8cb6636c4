"""Clearance of an arm from itself and its surroundings, proved for all times."""
