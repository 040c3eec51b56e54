"""Franka Research 3 and Franka Emika Robot ("Panda"), through pylibfranka (docs/franka.md)."""

from rtloop.backends.franka.backend import FrankaBackend

__all__ = ["FrankaBackend"]
