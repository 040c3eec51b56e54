"""`python -m cobot.ipc.generate`: write the struct that is made of the table of state fields.

It is the struct of the compiled modules, `cobot/ipc/state_scalars.pxd`. Its file notes the layout version and
a digest of all records in shared memory: a record that has changed under the same version is an error.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
from pathlib import Path

import numpy as np

from cobot.errors import ConfigError
from cobot.ipc import layout
from cobot.ipc import records as cycle_records
from cobot.ipc.shm import MAX_DOF
from cobot.ipc.state_fields import LAYOUT_VERSION, SCALARS, state_dtype

STRUCT = Path("cobot", "ipc", "state_scalars.pxd")
_C_TYPES = {"u8": "uint64_t", "i8": "int64_t", "f8": "double"}
_NOTE = "# Layout version {version}, records {digest}.\n"


def records_digest() -> str:
    """A digest of the records of `cobot.ipc.layout`, of `cobot.ipc.records` and of the state block, for each
    number of joints."""
    joints = range(1, MAX_DOF + 1)
    records = {f"state {dof}": state_dtype(dof) for dof in joints}
    for module in (layout, cycle_records):
        for name, value in vars(module).items():
            if isinstance(value, np.dtype):
                records[f"{module.__name__}.{name}"] = value
            elif name.endswith("_dtype"):
                records |= {f"{module.__name__}.{name} {dof}": value(dof) for dof in joints}
    described = [(name, records[name].descr, records[name].itemsize) for name in sorted(records)]
    return hashlib.sha256(repr(described).encode()).hexdigest()[:16]


def struct_text() -> str:
    """The Cython declaration of the state block's numbers."""
    fields = "".join(f"    {_C_TYPES[field.kind]} {field.name}\n" for field in SCALARS)
    return (
        "# Written by `python -m cobot.ipc.generate`; `cobot.ipc.state_fields` describes the fields.\n"
        f"{_NOTE.format(version=LAYOUT_VERSION, digest=records_digest())}"
        f"from libc.stdint cimport int64_t, uint64_t\n\ncdef struct StateScalars:\n{fields}"
    )


def require_version(noted: str) -> None:
    """Refuse records that have changed under the layout version of a struct's file.

    Raises:
        ConfigError: the version has to be raised.
    """
    pattern = re.escape(_NOTE.strip()).replace(r"\{version\}", r"(\d+)").replace(r"\{digest\}", r"(\w+)")
    found = re.search(pattern, noted)
    if found and int(found[1]) == LAYOUT_VERSION and found[2] != records_digest():
        raise ConfigError(
            f"records in shared memory have changed, but LAYOUT_VERSION is still {LAYOUT_VERSION}: raise it "
            "in cobot/ipc/state_fields.py, or undo the change"
        )


def write(root: Path) -> bool:
    """Bring the struct's file of a checkout up to date.

    Returns:
        Whether it has changed.

    Raises:
        ConfigError: a record has changed without its version.
        OSError: it is not a checkout.
    """
    file = root / STRUCT
    before = file.read_text("utf-8") if file.exists() else ""
    require_version(before)
    text = struct_text()
    if text != before:
        file.write_text(text, "utf-8")
    return text != before


def main() -> int:
    """The exit status: 0, or 2 when nothing was written."""
    argparse.ArgumentParser(prog="python -m cobot.ipc.generate", description=__doc__).parse_args()
    try:
        changed = write(Path(__file__).parents[2])
    except (ConfigError, OSError) as exc:
        print(exc, file=sys.stderr)
        return 2
    print(f"written: {STRUCT}" if changed else "nothing has changed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
