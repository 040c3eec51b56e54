"""Planners of others, which search paths for the problems of `problem_sets`."""
