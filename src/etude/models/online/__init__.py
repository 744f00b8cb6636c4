"""Learning while the robot runs."""
