"""Planners that find ways around obstacles: ompl and chomp."""
