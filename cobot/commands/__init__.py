"""The commands that use a running service: clients of it like any other."""
