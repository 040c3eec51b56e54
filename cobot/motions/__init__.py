"""Requests to the planners, in a package of their own: code that only makes requests imports no algorithm."""
