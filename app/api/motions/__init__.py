"""Requests to move, from what a client has written to what the services take."""
