"""The kinds of studies, and what only they use."""
