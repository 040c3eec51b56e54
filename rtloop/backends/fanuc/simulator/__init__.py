"""A simulated controller that uses Stream Motion and the Remote Motion Interface."""
