"""The commands that use a running service. They are ordinary service clients."""
