"""Motions whose TCP follows the path of the request: lin, circ, polyline."""
