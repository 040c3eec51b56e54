"""What a backend promises, as checks that anybody can run: `cobot backend test NAME`, or as tests of pytest.

rig         the device of a backend, in one process with it, and the faults that it can have
driver      rtloop's own cycle around a backend, stepped without a clock
cell        what the checks are about
stream      a client that streams
declared    what has to hold of what a class says of itself
checks      what has to hold while all is well
faults      what has to hold when something is not
suite       all checks of a backend, and what has come of them
plugin      the same for pytest: `-p rtloop.contract.plugin`
toy         a whole backend on a toy device, which `cobot backend new` makes a distribution of
"""

from __future__ import annotations

from rtloop.contract.rig import FAULTS, ContractRig

__all__ = ["FAULTS", "ContractRig"]
