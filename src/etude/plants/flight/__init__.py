"""Simulated quadrotors: rigid body, four motors with electrics, aerodynamics, cascaded control."""
