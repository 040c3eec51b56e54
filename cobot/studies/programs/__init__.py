"""Arm programs that a study examines."""
