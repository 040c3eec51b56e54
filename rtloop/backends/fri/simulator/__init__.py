"""A controller that speaks FRI without a robot behind it: our own dynamics, and the reflexes of a cabinet."""
