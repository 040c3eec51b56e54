"""`python -m app.endpoint_table`: all endpoints as they are declared, as the table of docs/endpoints.md."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from app.routes import ENDPOINTS
from cobot.config import load_endpoints
from cobot.errors import ConfigError


def table() -> Iterator[str]:
    """Its lines, as Markdown."""
    yield "| Endpoint | Role | Control | Timeout |"
    yield "|---|---|---|---|"
    for endpoint in sorted(ENDPOINTS.values(), key=lambda each: each.name.split()[::-1]):
        control = "yes" if endpoint.control else ""
        yield f"| `{endpoint.name}` | {endpoint.role.name.lower()} | {control} | {endpoint.timeout_s:g} |"


def main() -> int:
    """The exit status: 0, or 2 for a file that is wrong."""
    parser = argparse.ArgumentParser(prog="python -m app.endpoint_table", description=__doc__)
    parser.add_argument("--check", type=Path, metavar="FILE", help="an api_endpoints.yaml to check instead")
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
