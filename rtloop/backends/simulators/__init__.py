"""Parts that the simulated controllers for several manufacturers share."""
