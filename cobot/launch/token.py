"""`cobot token`: manages access to the service."""

from __future__ import annotations

import argparse
import math
import sys
from datetime import timedelta
from pathlib import Path
from typing import Any

from cobot.access.roles import Role
from cobot.access.tokens import MAX_DAYS, TokenFile
from cobot.audit import record_from_cli
from cobot.config import load_settings

ROLES = {role.name.lower(): role for role in Role if role is not Role.PUBLIC}
DESCRIPTION = """\
Manage the tokens with which clients access the service, see docs/security.md.

  observer     reads states, logs, health
  agent        also plans motions, and runs motions that an operator or the settings have approved
  operator     also moves the arm, resets it, streams to it, runs existing programs
  programmer   also uploads programs, and changes tool, payload, limits
  admin        also reads the audit, and reloads the settings

A running service notices a new or revoked token within a second."""


def add_parser(commands: Any, config: argparse.ArgumentParser) -> None:
    """Add the command `cobot token` to the parser. `config` is a parser with the option --config."""
    parser = commands.add_parser(
        "token",
        help="create, list and revoke access tokens",
        description=DESCRIPTION,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    config = argparse.ArgumentParser(add_help=False, parents=[config])
    config.add_argument(
        "--file", type=Path, metavar="FILE", help="the file of tokens; by default web.tokens of the settings"
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    create = actions.add_parser(
        "create", parents=[config], help="create a token and print it; it is shown only once"
    )
    create.add_argument("name", metavar="NAME", help="name of a person or a program, for the audit")
    create.add_argument("--role", required=True, choices=list(ROLES))
    create.add_argument(
        "--days", type=_days, metavar="N", help="number of days until it expires; default: never"
    )
    actions.add_parser("list", parents=[config], help="print names, roles and times, never tokens")
    revoke = actions.add_parser("revoke", parents=[config], help="revoke a token")
    revoke.add_argument("name", metavar="NAME")


def run(chosen: argparse.Namespace) -> None:
    """Execute the command.

    Raises:
        CobotError: see `TokenFile`.
    """
    config: Path | None = chosen.config
    settings = load_settings(config)
    file = TokenFile(chosen.file or settings.web.tokens)
    if chosen.action != "list":  # another user has a different file, unless the settings name one
        print(f"in {file.path}", file=sys.stderr)
    match chosen.action:
        case "create":
            print(file.create(chosen.name, ROLES[chosen.role], chosen.days))
            record_from_cli(settings, f"token create {chosen.name} --role {chosen.role}")
        case "revoke":
            file.revoke(chosen.name)
            print(f"revoked {chosen.name}")
            record_from_cli(settings, f"token revoke {chosen.name}")
        case "list":
            for each in file.read():
                ends = f"until {each.expires:%Y-%m-%d %H:%M} UTC" if each.expires else "no end"
                print(f"{each.name:<24} {each.role:<10} made {each.created:%Y-%m-%d %H:%M} UTC, {ends}")


def _days(argument: str) -> timedelta:
    try:
        days = float(argument)
    except ValueError:
        days = math.nan
    if not days > 0.0:
        raise argparse.ArgumentTypeError(f"{argument!r} is not a number of days above 0")
    if days > MAX_DAYS:
        raise argparse.ArgumentTypeError(
            f"{argument!r} days are too many, allowed: up to {MAX_DAYS}; without --days, the token "
            "never expires"
        )
    return timedelta(days=days)
