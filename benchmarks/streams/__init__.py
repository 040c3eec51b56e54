"""Streams, servo points and stops: latency, smoothness, overshoot."""
