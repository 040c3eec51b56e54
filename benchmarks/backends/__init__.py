"""The makers' protocols, against their simulators."""
