"""All scenarios, by their names."""

from golden import cartesian, joint, planned, servo
from golden.stage import SCENARIOS

__all__ = ["SCENARIOS", "cartesian", "joint", "planned", "servo"]
