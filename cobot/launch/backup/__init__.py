"""Backups of configuration and programs, and bundles for support."""
