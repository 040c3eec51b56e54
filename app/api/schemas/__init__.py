"""Requests and answers as JSON: models that document themselves."""
