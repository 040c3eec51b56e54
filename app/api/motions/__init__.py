"""Conversion of requests to move into the types that the services take."""
