"""Fleets: cells on several computers, and a hub that shows all of them and can stop them; see docs/fleet.md.

The process of a cell is a client of its own service, and reads its robots' shared memory. No motion needs it,
the hub or the network.
"""
