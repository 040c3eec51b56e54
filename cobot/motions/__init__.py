"""Requests to the planners. They are a separate package, so that code with requests does not import the
planners.
"""
