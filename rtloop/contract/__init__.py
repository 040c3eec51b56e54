"""The contract of backends as checks: run them with `cobot backend test NAME`, or as pytest tests.

rig         a backend and its device in one process, and the faults that it can have
driver      rtloop's own cycle around a backend, stepped without a clock
cell        the subject of the checks
stream      a client that streams
declared    checks of what a class declares about itself
checks      checks without faults
faults      checks with faults
suite       all checks of a backend, and their results
plugin      the checks for pytest: `-p rtloop.contract.plugin`
toy         a complete backend with a toy device, from which `cobot backend new` makes a distribution
"""

from __future__ import annotations

from rtloop.contract.rig import FAULTS, ContractRig

__all__ = ["FAULTS", "ContractRig"]
