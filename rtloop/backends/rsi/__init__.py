"""KUKA's RobotSensorInterface (RSI): the telegrams, the backend, and a simulated controller."""

from rtloop.backends.rsi.backend import RsiBackend

__all__ = ["RsiBackend"]
