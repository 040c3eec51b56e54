"""`cobot backend`: list, new, test, files."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from cobot.config import load_settings
from cobot.contract_checks import CheckResult, CheckVerdict
from cobot.errors import CobotError, ConfigError
from cobot.launch.new_package import write_package
from cobot.launch.process import in_words
from cobot.robot.description import load_robot
from rtloop.backends import BackendError, backend_class
from rtloop.contract.listing import listed
from rtloop.contract.new_backend import write_backend
from rtloop.contract.suite import CHECKS, cell_for, examine

EXIT_OK, EXIT_FAILED = 0, 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return the exit status: 0, or 1 if a check fails or cannot be run."""
    chosen = _parser().parse_args(arguments)
    commands = {"list": _list, "new": _new, "test": _test, "files": _files}
    try:
        return in_words(lambda: commands[chosen.command](chosen))
    except (CobotError, BackendError) as exc:
        print(f"cobot: {exc}", file=sys.stderr)
        return EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("cobot backend", description="Backends of robots: docs/your-backend.md.")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    shown = commands.add_parser("list", help="list all backends, what each can do, and whether it works here")
    shown.add_argument("--json", action="store_true", help="print JSON, for programs")
    new = commands.add_parser("new", help="create a package with a working backend for a toy device")
    new.add_argument("name", metavar="NAME", help="name for robot.backend, such as my_arm")
    new.add_argument("--dir", type=Path, default=Path(), metavar="DIR", help="folder in which to create it")
    new.add_argument(
        "--trajectory", action="store_true", help="create a backend for a device that takes whole motions"
    )
    test = commands.add_parser("test", help="run the contract on a backend and its simulated device")
    test.add_argument("name", metavar="NAME", help="a name from `list`, or package.module:Class")
    test.add_argument(
        "--config", type=Path, metavar="FILE", help="settings file with the arm and its options"
    )
    test.add_argument("--realtime", action="store_true", help="check durations too")
    test.add_argument(
        "--only", nargs="+", choices=list(CHECKS), metavar="CHECK", help="run only these checks"
    )
    test.add_argument("--json", action="store_true", help="print JSON, for programs")
    files = commands.add_parser("files", help="write the files that its robot controller needs")
    files.add_argument("name", metavar="NAME", help="a name from `list`, or package.module:Class")
    files.add_argument("folder", type=Path, metavar="FOLDER", help="folder to create")
    files.add_argument("--config", type=Path, metavar="FILE", help="settings with the arm and its options")
    return parser


def _list(chosen: argparse.Namespace) -> int:
    backends = listed()
    if chosen.json:
        print(json.dumps([each.as_dict() for each in backends], indent=2))
        return EXIT_OK
    for each in backends:
        print(f"{each.name}  ({each.origin}, {each.place})")
        for line in (each.capabilities, each.problem and f"cannot be used here: {each.problem}"):
            if line:
                print(f"    {line}")
        print(f"    the contract runs on: {each.contract}")
    return EXIT_OK


def _new(chosen: argparse.Namespace) -> int:
    folder = write_backend(chosen.name, chosen.dir, trajectory=chosen.trajectory)
    print(f"{folder} has been created.")
    print(f"Then: pip install -e {folder} and cobot backend test {chosen.name}")
    return EXIT_OK


def _files(chosen: argparse.Namespace) -> int:
    settings = load_settings(chosen.config)
    write = getattr(backend_class(chosen.name), "controller_files", None)
    if write is None:
        raise ConfigError(f"the backend {chosen.name} does not provide files for a robot controller")
    if settings.robot.backend.type != chosen.name:
        raise ConfigError(
            f"robot.backend is {settings.robot.backend.type}, not {chosen.name}; name the settings with "
            "its options with --config, because the files depend on them"
        )
    files = write(settings, load_robot(settings).limits)
    write_package(chosen.folder, files)
    for place in files:
        print(chosen.folder / place)
    return EXIT_OK


def _test(chosen: argparse.Namespace) -> int:
    cell = cell_for(load_settings(chosen.config), chosen.name, realtime=chosen.realtime)
    results = []
    width = max(map(len, CHECKS))
    for check in chosen.only or CHECKS:
        result = examine(cell, check)
        results.append(result)
        if not chosen.json:
            print(f"{check:{width}}  {result.verdict:10}  {result.found}", flush=True)
    if chosen.json:
        print(json.dumps([_as_dict(each) for each in results], indent=2))
    else:
        counted = ", ".join(
            f"{sum(each.verdict is verdict for each in results)} {verdict}" for verdict in CheckVerdict
        )
        print(f"{chosen.name}, every {1e3 * cell.settings.rt.period_s:g} ms: {counted}")
    failed = any(each.verdict is CheckVerdict.FAILED for each in results)
    return EXIT_FAILED if failed else EXIT_OK


def _as_dict(result: CheckResult) -> dict[str, str]:
    return {"check": result.check, "result": result.verdict.value, "found": result.found}


if __name__ == "__main__":
    sys.exit(main())
