"""The `cobot` command."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from cobot.addresses import address
from cobot.client.tls import CERTIFICATE_VARIABLE, TOKEN_VARIABLE
from cobot.commands import options
from cobot.config import Settings, advice, load_settings, load_with_rolled_out
from cobot.errors import CobotError, ConfigError
from cobot.foreign import plain_lines
from cobot.launch import backup_options, recording_options
from cobot.launch.parser import MODULES, SIMULATORS, make_parser
from cobot.launch.process import RUN_MODULE, as_command, in_words, require_limits

EXIT_OK, EXIT_FAILED, EXIT_USAGE = 0, 1, 2
RUN_BY = {
    "token": "cobot.launch.token",
    **dict.fromkeys(backup_options.COMMANDS, "cobot.launch.backups"),
    **dict.fromkeys(recording_options.COMMANDS, "cobot.launch.recordings"),
}
"""Modules whose function `run` executes a command."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status: 0 for success, 1 for failure, 2 for wrong usage."""
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0] in MODULES:
        return as_command(lambda: int(import_module(MODULES[words[0]]).main(words[1:])))
    parser = make_parser()
    chosen = parser.parse_args(arguments)
    chosen.is_program = arguments is None  # otherwise the caller owns the process, which may have threads
    if chosen.command is None:
        parser.print_help()
        return EXIT_USAGE
    if chosen.command in ("lua", "mcp"):
        _become_client(chosen)
    if chosen.command == "simulate":
        os.execv(RUN_MODULE[0], [*RUN_MODULE, SIMULATORS[chosen.device], *chosen.options])
    if options.for_service(chosen, parser):
        from cobot.commands import actions

        return as_command(lambda: actions.run(chosen, parser))
    return in_words(lambda: _run(chosen))


def _run(chosen: argparse.Namespace) -> int:
    """Run the command. Only the modules that this command needs are imported."""
    settings = None
    try:
        if chosen.command in RUN_BY:
            import_module(RUN_BY[chosen.command]).run(chosen)
            return EXIT_OK
        match chosen.command:
            case "stop":
                return _stop(chosen)
            case "doctor":
                return _doctor(chosen)
            case "install" | "uninstall":
                return _install(chosen)
            case "new-robot":
                return _new_robot(chosen)
        settings = load_with_rolled_out(chosen.config)
        match chosen.command:
            case "check":
                return _check(chosen, settings)
            case "moveit-config":
                return _write_moveit_config(chosen, settings)
        return _supervise(chosen, settings)
    except CobotError as exc:
        print(f"cobot: {plain_lines(exc)}", file=sys.stderr)
        if settings is not None and isinstance(exc, ConfigError):
            _advise(settings)
        return EXIT_FAILED


def _advise(settings: Settings) -> None:
    """Print a hint that names the settings from the fleet, because they may be the cause."""
    if hint := advice(settings):
        print(f"cobot: {hint}", file=sys.stderr)


def _doctor(chosen: argparse.Namespace) -> int:
    from cobot.launch.doctor import doctor

    return EXIT_OK if doctor(chosen.config, sys.stdout, as_json=chosen.json) else EXIT_FAILED


def _install(chosen: argparse.Namespace) -> int:
    from cobot.launch.install import install, uninstall

    change = install if chosen.command == "install" else uninstall
    change(sys.stdout, chosen.prefix, dry_run=chosen.dry_run)
    return EXIT_OK


def _check(chosen: argparse.Namespace, settings: Settings) -> int:
    from cobot.launch.check import check

    items = check(settings, chosen.config, sys.stdout)
    if chosen.hardware:
        from cobot.launch.hardware import check_hardware

        items = items + check_hardware(settings, items, sys.stdout)
    if all(item.good for item in items):
        return EXIT_OK
    _advise(settings)
    return EXIT_FAILED


def _write_moveit_config(chosen: argparse.Namespace, settings: Settings) -> int:
    from cobot.launch.moveit import write_moveit_config

    print(write_moveit_config(settings, chosen.folder))
    return EXIT_OK


def _supervise(chosen: argparse.Namespace, settings: Settings) -> int:
    """Run the robots and the service until they are stopped."""
    require_limits()
    from cobot.launch.backups import restore_staged
    from cobot.launch.forked import fork_processes
    from cobot.launch.supervisor import Supervisor

    settings = _with_cell(restore_staged(settings, chosen.config), chosen.cell)
    given = _overridden(settings, chosen)
    processes = len(given.each) + 1 + given.web.enabled + given.ros.enabled + bool(given.fleet.connect)
    if chosen.is_program:
        os.umask(0o077)  # only the user may read what this process and its children write
    blanks = fork_processes(processes) if chosen.is_program else []
    try:
        return Supervisor(given, chosen.config, settings, blanks).run()
    finally:
        for blank in blanks:
            blank.dismiss()


def _new_robot(chosen: argparse.Namespace) -> int:
    if chosen.ros is None:
        return _new_robot_of(chosen, chosen.file)
    from cobot.launch.new_robot.from_ros import save_description

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{chosen.ros.strip('/').replace('/', '_') or 'robot'}.urdf"
        save_description(chosen.ros, file)
        return _new_robot_of(chosen, file)


def _new_robot_of(chosen: argparse.Namespace, file: Path) -> int:
    from cobot.launch.new_robot.masses import Wishes
    from cobot.launch.new_robot.new_robot import NewRobot
    from cobot.launch.robot_file.typed import typed

    robot = NewRobot(
        file,
        chosen.actuators,
        chosen.without,
        chosen.package,
        chosen.base,
        chosen.tcp,
        wishes=Wishes(chosen.density, dict(chosen.mass)),
        srdf=chosen.srdf,
        group=chosen.group,
        hulls=chosen.hulls,
        skip_missing_meshes=chosen.skip_missing_meshes,
        xacro=dict(chosen.xacro),
    )
    folder = chosen.output or Path(file.name.split(".")[0])
    robot.write(folder)
    print(f"{folder} has been created. Check these guessed values:")
    for sentence in robot.guessed:
        print(f"  {plain_lines(sentence)}")
    config = typed("--config", str(folder))
    print(f"Then: cobot check {config} and cobot run {config}")
    return EXIT_OK


def _stop(chosen: argparse.Namespace) -> int:
    """Stop robots. This needs no settings, so it also works when the settings cannot be read."""
    from cobot.audit import record_from_cli
    from cobot.launch.stop import not_asked, stop

    robots = (
        [chosen.robot] if chosen.robot else list(load_settings(chosen.config).each) if chosen.config else []
    )
    at_rest = stop(robots, latched=chosen.estop, out=sys.stdout)
    if hint := not_asked(os.environ.get(options.URL_VARIABLE)):
        print(f"cobot: {hint}", file=sys.stderr)
    what = f"{'e-stop' if chosen.estop else 'stop'} {' '.join(robots)}".rstrip()
    outcome = "ok" if at_rest else "not known to be at rest"
    for settings in _running(robots) or [load_settings(chosen.config)]:
        record_from_cli(settings, what, outcome)
    return EXIT_OK if at_rest else EXIT_FAILED


def _running(robots: Sequence[str]) -> list[Settings]:
    """The settings of this user's running cobots that have one of these robots. If `robots` is empty, the
    settings of all running cobots.
    """
    from cobot.launch.running_config import RunningConfig

    found = []
    for running in RunningConfig.mine():
        with contextlib.suppress(CobotError):
            settings = load_settings(running.file)
            if not robots or not settings.each.keys().isdisjoint(robots):
                found.append(settings)
    return found


def _become_client(chosen: argparse.Namespace) -> NoReturn:
    """Replace this process by the program runner or the agents' bridge. Both are ordinary service clients."""
    url = options.url_of(chosen)
    if chosen.command == "lua":
        url = address(url, chosen.robot) if chosen.robot else url
        command = [*RUN_MODULE, "cobot.runner", "run", "--lua", "--url", url, "--", str(chosen.file)]
    else:
        command = [*RUN_MODULE, "app.mcp", "--url", url]
    given = {TOKEN_VARIABLE: chosen.token, CERTIFICATE_VARIABLE: chosen.certificate}
    os.environ.update({name: str(value) for name, value in given.items() if value is not None})
    os.execv(command[0], command)


def _with_cell(settings: Settings, cell: Path | None) -> Settings:
    """The settings with this cell for the default robot. If the cell is None, the settings stay unchanged."""
    if cell is None:
        return settings
    from cobot.cell.cell import cell_file

    robot = {"robot": settings.robot.model_copy(update={"cell": cell_file(cell.resolve())})}
    robots = tuple(each.model_copy(update=robot) for each in settings.robots[:1]) + settings.robots[1:]
    return settings.model_copy(update={**robot, "robots": robots})


def _overridden(settings: Settings, chosen: argparse.Namespace) -> Settings:
    web = {key: getattr(chosen, key) for key in ("host", "port") if getattr(chosen, key) is not None}
    rt = {"clock": chosen.clock} if chosen.clock else {}
    return settings.model_copy(
        update={
            "web": settings.web.model_copy(update=web),
            "rt": settings.rt.model_copy(update=rt),
            "robots": tuple(_overridden(each, chosen) for each in settings.robots),
        }
    )
