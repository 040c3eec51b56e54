"""Golden traces: scenarios of the real-time core on the virtual clock, and what was recorded of them."""
