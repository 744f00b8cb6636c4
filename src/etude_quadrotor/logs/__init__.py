"""Logs of flight controllers: PX4's ULog, the Crazyflie's card."""
