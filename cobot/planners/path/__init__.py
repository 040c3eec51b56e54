"""Motions whose TCP follows the path of the request."""
