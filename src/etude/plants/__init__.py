"""Simulated robots: pure dynamics with their parameters in data files, behind one interface."""

from etude.plants.registry import plant_names, simulated_robot
from etude.plants.robot import Gains, SimulatedRobot

__all__ = ["Gains", "SimulatedRobot", "plant_names", "simulated_robot"]
