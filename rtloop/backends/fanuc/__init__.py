"""FANUC's Stream Motion and Remote Motion Interface: the messages, the backend, and a simulated
controller.
"""

from rtloop.backends.fanuc.backend import FanucBackend

__all__ = ["FanucBackend"]
