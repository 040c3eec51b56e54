"""A simulated Universal Robots controller."""
