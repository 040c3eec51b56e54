"""Random requests to every planner. Each answer is judged without cobot."""
