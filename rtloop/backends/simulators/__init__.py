"""Parts that the simulated controllers of several makers share."""
