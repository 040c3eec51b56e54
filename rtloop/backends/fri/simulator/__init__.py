"""A simulated FRI controller: cobot's own dynamics with the behaviour of a KUKA cabinet."""
