"""`cobot gripper`: list, new, test."""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

from cobot.config import load_settings
from cobot.contract_checks import CheckVerdict
from cobot.errors import CobotError, ConfigError
from cobot.grippers.contract.new import write_gripper
from cobot.grippers.contract.suite import CHECKS, examine, subject_for
from cobot.grippers.registry import REGISTRY
from cobot.launch.process import in_words


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return the exit status: 0 for success, 1 if a check fails or cannot be run."""
    chosen = _parser().parse_args(arguments)
    commands = {"list": _list, "new": _new, "test": _test}
    try:
        return in_words(lambda: commands[chosen.command](chosen))
    except CobotError as exc:
        print(f"cobot: {exc}", file=sys.stderr)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("cobot gripper", description="Grippers: docs/your-gripper.md.")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    commands.add_parser("list", help="list all types, and whether each can be used on this computer")
    new = commands.add_parser("new", help="write a package with a working gripper for a toy device")
    new.add_argument("name", metavar="NAME", help="name of the type in robot.gripper, such as my_gripper")
    new.add_argument(
        "--dir", type=Path, default=Path(), metavar="DIR", help="folder in which the package is created"
    )
    test = commands.add_parser("test", help="run the contract on a gripper and its simulated device")
    test.add_argument("name", metavar="NAME", help="a type that `list` shows, or package.module:Class")
    test.add_argument(
        "--config", type=Path, metavar="FILE", help="settings file with the options of the gripper"
    )
    test.add_argument(
        "--option",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="options of the gripper instead of those in the settings",
    )
    test.add_argument(
        "--only", nargs="+", choices=list(CHECKS), metavar="CHECK", help="run only these checks"
    )
    test.add_argument("--json", action="store_true", help="print the results as JSON, for programs")
    return parser


def _list(chosen: argparse.Namespace) -> int:
    origins = REGISTRY.origins()
    for name, place in sorted(REGISTRY.names().items()):
        print(f"{name}  ({origins[name]}, {place})")
        try:
            kind: Any = REGISTRY.load(name)
        except ConfigError as exc:
            print(f"    cannot be used on this computer: {exc}")
            continue
        sdk = getattr(kind, "sdk", "")
        if sdk and importlib.util.find_spec(sdk) is None:
            print(f"    cannot be used on this computer: {sdk} is not installed")
        options = getattr(kind, "Options", None)
        fields = {} if options is None else options.model_fields
        required = [key for key, field in fields.items() if field.is_required()]
        print(f"    options: {', '.join(f'{key} (required)' if key in required else key for key in fields)}")
        on = "simulated device" if hasattr(kind, "contract_rig") else "nothing"
        print(f"    simulated device for the contract: {on}")
    return 0


def _new(chosen: argparse.Namespace) -> int:
    folder = write_gripper(chosen.name, chosen.dir)
    print(f"{folder} has been created.")
    print(f"Then: pip install -e {folder} and cobot gripper test {chosen.name}")
    return 0


def _test(chosen: argparse.Namespace) -> int:
    make = subject_for(load_settings(chosen.config), chosen.name, _options(chosen.option))
    results = []
    width = max(map(len, CHECKS))
    for check in chosen.only or CHECKS:
        result = examine(make, check)
        results.append(result)
        if not chosen.json:
            print(f"{check:{width}}  {result.verdict:10}  {result.found}", flush=True)
    if chosen.json:
        print(json.dumps([asdict(each) for each in results], indent=2))
    return 1 if any(each.verdict is CheckVerdict.FAILED for each in results) else 0


def _options(given: Sequence[str]) -> dict[str, Any]:
    found = {}
    for each in given:
        name, equals, value = each.partition("=")
        if not (name and equals):
            raise ConfigError(f"--option: {each!r} is not NAME=VALUE, such as model=hande")
        try:
            found[name] = yaml.safe_load(value)
        except yaml.YAMLError as exc:
            raise ConfigError(f"--option: {each!r} cannot be read: {' '.join(str(exc).split())}") from exc
    return found


if __name__ == "__main__":
    sys.exit(main())
