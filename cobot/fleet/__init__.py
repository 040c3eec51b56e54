"""Fleets: cells on several computers, and a hub that shows all of them and can stop them. See docs/fleet.md.

The fleet process of a cell is a client of the cell's service, and also reads the shared memory of the cell's
robots. Motions do not depend on this process, the hub or the network.
"""
