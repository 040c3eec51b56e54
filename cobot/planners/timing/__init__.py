"""Joint curves and their time parameterization, and points that come with times."""
