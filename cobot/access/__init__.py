"""Who may do what: roles, identities and the tokens that prove them. Knows no web framework."""
