"""A controller that speaks Stream Motion and the Remote Motion Interface, without a robot behind it."""
