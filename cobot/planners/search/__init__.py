"""Ways around obstacles: ompl and chomp."""
