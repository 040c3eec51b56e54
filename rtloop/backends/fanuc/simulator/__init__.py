"""A controller that uses Stream Motion and the Remote Motion Interface, without a real robot."""
