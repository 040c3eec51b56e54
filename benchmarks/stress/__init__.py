"""Random requests of every planner, each answer judged without cobot."""
