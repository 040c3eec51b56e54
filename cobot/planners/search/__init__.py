"""Planners that find paths around obstacles: ompl and chomp."""
