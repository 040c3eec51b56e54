"""The command line of the service."""

from __future__ import annotations

import argparse
from pathlib import Path


def read_arguments() -> argparse.Namespace:
    """Read the arguments that `cobot run` passes to the service."""
    parser = argparse.ArgumentParser(prog="python -m app", description="The web service.")
    parser.add_argument("--config", type=Path, help="settings file; by default the one that is part of cobot")
    parser.add_argument(
        "--source", type=Path, help="the file that the user edits, if the settings file is a copy of it"
    )
    parser.add_argument("--host", required=True, help="address that the socket listens on")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--fd", type=int, required=True, help="descriptor of the listening socket")
    parser.add_argument("--losses-fd", type=int, help=argparse.SUPPRESS)
    return parser.parse_args()
