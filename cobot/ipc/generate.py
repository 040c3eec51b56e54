"""`python -m cobot.ipc.generate`: writes the files and parts of files that are derived from the state fields.

These are the declarations for compiled modules (`cobot/ipc/state_block.pxd`) and the attributes of
`rtloop.backends.Measured` (`rtloop/backends/compiled.pyi`). The declarations contain the layout version and a
digest of all records in shared memory. If a record has changed without a new version, this is an error.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cobot.errors import ConfigError
from cobot.ipc import layout
from cobot.ipc import records as cycle_records
from cobot.ipc.shm import MAX_DOF
from cobot.ipc.state_fields import (
    LAYOUT_VERSION,
    MEASURED,
    PER_JOINT,
    SCALARS,
    STATE_FIELDS,
    StateField,
    state_dtype,
)

DECLARATIONS = Path("cobot", "ipc", "state_block.pxd")
STUB = Path("rtloop", "backends", "compiled.pyi")
BEGIN, END = "    # measured fields: begin\n", "    # measured fields: end\n"
"""The lines before and after the generated part of the stub."""
LAST_MEASURED = ("external_effort", "wrench", "sensor")
_C_TYPES = {"u8": "uint64_t", "i8": "int64_t", "f8": "double"}
_NOTE = "# Layout version {version}, records {digest}.\n"


def records_digest() -> str:
    """A digest of all records in shared memory: those of `cobot.ipc.layout`, those of `cobot.ipc.records` and
    the state block. It covers every possible number of joints.
    """
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


def declarations() -> str:
    """The declarations for compiled modules: the numbers of the state block, and the rows of the measured
    values.
    """
    fields = "".join(f"    {_C_TYPES[field.kind]} {field.name}\n" for field in SCALARS)
    joints = [field.name for field in MEASURED if field.length == PER_JOINT]
    rows = "".join(f"    {name.upper()}_ROW = {row}\n" for row, name in enumerate(joints))
    more = sum(field.length for field in MEASURED if field.length != PER_JOINT)
    return (
        "# Written by `python -m cobot.ipc.generate`; `cobot.ipc.state_fields` describes the fields.\n"
        f"{_NOTE.format(version=LAYOUT_VERSION, digest=records_digest())}"
        f"from libc.stdint cimport int64_t, uint64_t\n\ncdef struct StateScalars:\n{fields}\n"
        "# Rows of `dof` numbers in the values of `rtloop.backends.Measured`; the wrench follows them.\n"
        f"cdef enum:\n{rows}    MEASURED_ROWS = {len(joints)}\n\n"
        "# The number of these values.\n"
        "cdef inline int count_measured(int dof) noexcept nogil:\n"
        f"    return {len(joints)} * dof + {more}\n"
    )


def attributes() -> Iterator[str]:
    """Yield the lines of a stub file that declare the measured fields as attributes of a class."""
    for field in MEASURED:
        yield f"    # {field.meaning}; {field.unit}."
        yield f"    {field.name}: Array"


def with_attributes(stub: str) -> str:
    """The stub file with the generated attributes between its marks.

    Raises:
        ConfigError: the marks are missing.
    """
    before, begin, rest = stub.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ConfigError(
            f"{STUB} has no lines {BEGIN.strip()} and {END.strip()}: put them where the attributes go"
        )
    return before + begin + "".join(f"{line}\n" for line in attributes()) + end + after


def require_order(measured: tuple[StateField, ...]) -> None:
    """Reject measured fields that are not at the position where compiled modules expect them.

    Raises:
        ConfigError: a field must be at a different position in the table.
    """
    names = tuple(field.name for field in measured)
    table_names = [field.name for field in STATE_FIELDS]
    first = table_names.index(names[0])
    rows = [field for field in measured if field.length == PER_JOINT]
    if (
        names[-len(LAST_MEASURED) :] != LAST_MEASURED
        or table_names[first : first + len(names)] != list(names)
        or any(field.kind != "f8" for field in measured)
        or measured[: len(rows)] != tuple(rows)
    ):
        raise ConfigError(
            f"the measured fields are {', '.join(names)}: list them together in cobot/ipc/state_fields.py, "
            f'of kind "f8", fields per joint first; {LAST_MEASURED[0]}, {LAST_MEASURED[1]} and '
            f"{LAST_MEASURED[2]} must be the last ones"
        )


def require_version(noted: str) -> None:
    """Reject records that have changed if the layout version is still the one in the declarations.

    Raises:
        ConfigError: the version must be increased.
    """
    pattern = re.escape(_NOTE.strip()).replace(r"\{version\}", r"(\d+)").replace(r"\{digest\}", r"(\w+)")
    found = re.search(pattern, noted)
    if found and int(found[1]) == LAYOUT_VERSION and found[2] != records_digest():
        raise ConfigError(
            f"records in shared memory have changed, but LAYOUT_VERSION is still {LAYOUT_VERSION}: raise it "
            "in cobot/ipc/state_fields.py, or undo the change"
        )


def write(root: Path) -> list[Path]:
    """Update the generated files of a checkout.

    Returns:
        The files that have changed.

    Raises:
        ConfigError: a record has changed without a new version, a measured field is at the wrong position, or
            the marks in the stub file are missing.
        OSError: the folder is not a checkout.
    """
    before = {DECLARATIONS: "", STUB: (root / STUB).read_text("utf-8")}
    if (root / DECLARATIONS).exists():
        before[DECLARATIONS] = (root / DECLARATIONS).read_text("utf-8")
    require_order(MEASURED)
    require_version(before[DECLARATIONS])
    texts = {DECLARATIONS: declarations(), STUB: with_attributes(before[STUB])}
    changed = [path for path in texts if texts[path] != before[path]]
    for path in changed:
        (root / path).write_text(texts[path], "utf-8")
    return changed


def main() -> int:
    """Run the command. Returns the exit status: 0, or 2 if no file was written."""
    argparse.ArgumentParser(prog="python -m cobot.ipc.generate", description=__doc__).parse_args()
    try:
        changed = write(Path(__file__).parents[2])
    except (ConfigError, OSError) as exc:
        print(exc, file=sys.stderr)
        return 2
    print("\n".join(f"written: {path}" for path in changed) or "nothing has changed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
