"""Common parts of the simulated controllers."""
