"""Backend for Universal Robots arms with e-Series, UR-Series and CB3 controllers."""

from rtloop.backends.ur.backend import UrBackend

__all__ = ["UrBackend"]
