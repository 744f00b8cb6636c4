"""The vessel keeps the laws of every kind of robot."""

from etude_vessel import KIND

from etude.testing import KindSuite


class TestVessel(KindSuite):
    kind, robot = KIND, "vessel"
