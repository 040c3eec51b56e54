"""The commands that use a running service. They are ordinary clients of the service."""
