"""The backend contract as executable checks. Run them with `cobot backend test NAME`, or as pytest tests.

rig         a backend and its device in one process, and the faults that the device can simulate
driver      rtloop's own cycle around a backend, stepped without a clock
cell        the backend and the arm that the checks examine
stream      a client that streams
declared    checks of the capabilities and options that a class declares
checks      checks without faults
faults      checks with faults
suite       runs all checks of a backend and collects their results
plugin      the checks for pytest: `-p rtloop.contract.plugin`
toy         a complete backend with a toy device, from which `cobot backend new` makes a distribution
"""

from __future__ import annotations

from rtloop.contract.rig import FAULTS, ContractRig

__all__ = ["FAULTS", "ContractRig"]
