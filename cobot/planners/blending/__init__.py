"""Blending: several motions become one that passes their ends without a stop."""
