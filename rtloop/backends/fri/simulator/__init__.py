"""A controller that uses FRI without a real robot: cobot's own dynamics, with the reactions of a cabinet."""
