"""The real-time loop: computing time, punctuality, latency of states, at rest and under load."""
