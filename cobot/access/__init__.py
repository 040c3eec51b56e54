"""Roles, identities and the tokens that prove them. This package does not depend on a web framework."""
