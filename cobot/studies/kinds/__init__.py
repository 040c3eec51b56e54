"""The kinds of studies, and code that only they use."""
