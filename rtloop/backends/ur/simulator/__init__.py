"""A controller of Universal Robots without a robot."""
