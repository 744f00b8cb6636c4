"""Exports of a vehicle: code for autopilots, PX4 set-points, Crazyflie polynomials."""
