"""KUKA's Fast Robot Interface: messages, backend, and a simulated controller."""

from rtloop.backends.fri.backend import FriBackend

__all__ = ["FriBackend"]
