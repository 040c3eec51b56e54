"""KUKA's Fast Robot Interface (FRI): the messages, the backend, and a simulated controller."""

from rtloop.backends.fri.backend import FriBackend

__all__ = ["FriBackend"]
