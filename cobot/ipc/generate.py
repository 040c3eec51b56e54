"""`python -m cobot.ipc.generate`: write what is made of the table of state fields.

That is the struct of the compiled modules (`cobot/ipc/state_scalars.pxd`) and the table in docs/api.md. The
struct's file notes the layout version and a digest of all records in shared memory: a record that has changed
under the same version is an error.
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
from cobot.ipc.state_fields import LAYOUT_VERSION, PER_JOINT, SCALARS, STATE_FIELDS, StateField, state_dtype

STRUCT = Path("cobot", "ipc", "state_scalars.pxd")
DOCUMENT = Path("docs", "api.md")
BEGIN, END = "<!-- state fields: begin -->\n", "<!-- state fields: end -->\n"
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


def table() -> Iterator[str]:
    """The fields as a Markdown table, line by line."""
    yield "| Field | Type | Unit | Meaning | Recorded |"
    yield "|---|---|---|---|---|"
    for field in STATE_FIELDS:
        recorded = f"`{field.topic}`" if field.message else "yes" if field.recorded else ""
        yield f"| `{field.name}` | {_json_type(field)} | {field.unit} | {field.meaning} | {recorded} |"


def document_with_table(document: str) -> str:
    """The document with the table between its marks.

    Raises:
        ConfigError: the marks are missing.
    """
    before, begin, rest = document.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ConfigError(
            f"{DOCUMENT} has no lines {BEGIN.strip()} and {END.strip()}: put them where the table goes"
        )
    return before + begin + "\n" + "\n".join(table()) + "\n\n" + end + after


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


def _json_type(field: StateField) -> str:
    if field.member is not None:
        return ", ".join(f"`{member.name}`" for member in field.member)
    if field.keys is not None:
        return "object of integers"
    kind = {"f": "number", "u": "integer", "i": "integer"}.get(field.kind[0])
    if kind is None:
        return "string"
    if field.length == PER_JOINT:
        return f"{kind} per joint"
    return f"{field.length} {kind}s" if field.length else kind


def write(root: Path) -> list[Path]:
    """Bring the files of a checkout up to date.

    Returns:
        Those that have changed.

    Raises:
        ConfigError: a record has changed without its version, or docs/api.md has no place for the table.
        OSError: it is not a checkout.
    """
    texts = {STRUCT: "", DOCUMENT: (root / DOCUMENT).read_text("utf-8")}
    if (root / STRUCT).exists():
        texts[STRUCT] = (root / STRUCT).read_text("utf-8")
    require_version(texts[STRUCT])
    wanted = {STRUCT: struct_text(), DOCUMENT: document_with_table(texts[DOCUMENT])}
    changed = [path for path in wanted if wanted[path] != texts[path]]
    for path in changed:
        (root / path).write_text(wanted[path], "utf-8")
    return changed


def main() -> int:
    """The exit status: 0, or 2 when nothing was written."""
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
