"""Motions one after the other: moves wait, are planned and joined, and are executed in their turn."""
