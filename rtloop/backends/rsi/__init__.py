"""KUKA's RobotSensorInterface: the telegrams, the backend, and a simulated controller."""

from rtloop.backends.rsi.backend import RsiBackend

__all__ = ["RsiBackend"]
