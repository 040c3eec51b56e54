"""Planners by other authors, which search paths for the problems of `problem_sets`."""
