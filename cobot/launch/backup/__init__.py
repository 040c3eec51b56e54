"""Backups of what people have set up, and bundles for support."""
