"""Recordings of a robot as MCAP files: what is in them, where they are, and what can be made of them."""
