"""Signals on the path, contact, grippers, and the simulated cell."""
