"""Joint curves and their time parameterization, and motions through points that clients send with times."""
