"""`python -m app.endpoint_table`: prints the declarations of all endpoints as the table in
docs/endpoints.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from app.routes import ENDPOINTS
from cobot.config import load_endpoints
from cobot.errors import ConfigError


def table() -> Iterator[str]:
    """Create the lines of the table, in Markdown."""
    yield "| Endpoint | Role | Control | Timeout |"
    yield "|---|---|---|---|"
    for endpoint in sorted(ENDPOINTS.values(), key=lambda each: each.name.split()[::-1]):
        control = "yes" if endpoint.control else ""
        yield f"| `{endpoint.name}` | {endpoint.role.name.lower()} | {control} | {endpoint.timeout_s:g} |"


def main() -> int:
    """Print the table. Returns the exit status: 0, or 2 for an invalid file."""
    parser = argparse.ArgumentParser(prog="python -m app.endpoint_table", description=__doc__)
    parser.add_argument("--check", type=Path, metavar="FILE", help="check this api_endpoints.yaml instead")
    file = parser.parse_args().check
    if file is None:
        print("\n".join(table()))
        return 0
    try:
        load_endpoints(file, ENDPOINTS)
    except ConfigError as exc:
        print(exc, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
