"""Roles, identities and the tokens that prove them. This package knows no web framework."""
