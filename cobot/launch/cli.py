"""The `cobot` command."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

from cobot.addresses import address
from cobot.client.tls import CERTIFICATE_VARIABLE, TOKEN_VARIABLE
from cobot.commands import options
from cobot.config import SETTINGS_FILE, Settings, load_settings
from cobot.errors import CobotError
from cobot.launch import recording_options, token
from cobot.launch.process import RUN_MODULE, in_words, require_limits

DESCRIPTION = """\
A robot arm behind a REST service.

  cobot run      start the simulated (or real) robot and the service, and watch over both
  cobot run FILE    run a sequence (.json) or program (.lua) at the service that runs, see docs/cli.md
  cobot state, move, send, jobs, watch, teleop   use a service that runs, see docs/cli.md
  cobot acknowledge   let a real robot move faster after a first look at it, see docs/safety.md
  cobot check    validate the whole configuration, without starting anything
  cobot simulate fri   a simulated robot controller for any client of KUKA's FRI, see docs/kuka-fri.md
  cobot backend  list, make and test what drives a robot, see docs/your-backend.md
  cobot new-robot   make the configuration of another arm from its URDF or MJCF, see docs/your-robot.md
  cobot stop     bring every arm of this computer to rest, whatever has become of the service
  cobot moveit-config   write a package with which MoveIt 2 plans for the robot, see docs/ros2.md
  cobot lua      run a Lua program at a running service, see docs/lua.md
  cobot record   write down what the robot did or does; cobot plot draws it, cobot replay moves the arm again
  cobot mcp      let an agent that speaks MCP over stdio use a running service, see docs/mcp.md
  cobot token    make, list and revoke the tokens that a service on the network asks for
  cobot doctor   whether this computer is fit for it, and what to type where it is not
  cobot completion  print what makes bash, zsh or fish complete commands
  cobot install  make it a service of systemd; cobot uninstall takes that back

The first run needs no configuration: open http://localhost:8007 and move the arm."""

SIMULATORS = {"fri": "rtloop.backends.fri.simulator"}
"""Modules of what `cobot simulate` runs; each knows its own options."""
EXIT_OK, EXIT_FAILED, EXIT_USAGE = 0, 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status: 0 good, 1 failed, 2 wrong usage."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    chosen.is_program = arguments is None  # else it is somebody's who may have threads
    if chosen.command is None:
        parser.print_help()
        return EXIT_USAGE
    if chosen.command in ("lua", "mcp"):
        _become_client(chosen)
    if chosen.command == "simulate":
        os.execv(RUN_MODULE[0], [*RUN_MODULE, SIMULATORS[chosen.device], *chosen.options])
    if chosen.command == "backend":
        os.execv(RUN_MODULE[0], [*RUN_MODULE, "rtloop.contract", *chosen.options])
    if options.for_service(chosen, parser):
        from cobot.commands import actions

        return in_words(lambda: actions.run(chosen, parser))
    return in_words(lambda: _run(chosen))


def _run(chosen: argparse.Namespace) -> int:
    """Imports what the command needs, and no more."""
    try:
        if chosen.command == "token":
            token.run(chosen)
            return EXIT_OK
        if chosen.command in recording_options.COMMANDS:
            from cobot.launch import recordings

            recordings.run(chosen)
            return EXIT_OK
        if chosen.command == "stop":
            return _stop(chosen)
        if chosen.command == "doctor":
            from cobot.launch.doctor import doctor

            return EXIT_OK if doctor(chosen.config, sys.stdout, as_json=chosen.json) else EXIT_FAILED
        if chosen.command == "install":
            from cobot.launch.install import install

            install(sys.stdout, chosen.prefix, dry_run=chosen.dry_run)
            return EXIT_OK
        if chosen.command == "uninstall":
            from cobot.launch.install import uninstall

            uninstall(sys.stdout, chosen.prefix, dry_run=chosen.dry_run)
            return EXIT_OK
        if chosen.command == "new-robot":
            return _new_robot(chosen)
        settings = load_settings(chosen.config)
        if chosen.command == "check":
            from cobot.launch.check import check

            items = check(settings, chosen.config, sys.stdout)
            if chosen.hardware:
                from cobot.launch.hardware import check_hardware

                items = items + check_hardware(settings, items, sys.stdout)
            return EXIT_OK if all(item.good for item in items) else EXIT_FAILED
        if chosen.command == "moveit-config":
            from cobot.launch.moveit import write_moveit_config

            print(write_moveit_config(settings, chosen.folder))
            return EXIT_OK
        require_limits()
        from cobot.launch.supervisor import Supervisor
        from cobot.launch.supervisor.forked import forked

        given = _overridden(settings, chosen)
        processes = len(given.each) + 1 + given.web.enabled + given.ros.enabled
        blanks = forked(processes) if chosen.is_program else []
        try:
            return Supervisor(given, chosen.config, settings, blanks).run()
        finally:
            for blank in blanks:
                blank.dismiss()
    except CobotError as exc:
        print(f"cobot: {exc}", file=sys.stderr)
        return EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "cobot", description=DESCRIPTION, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"cobot {version('cobot')}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    config = argparse.ArgumentParser(add_help=False)
    config.add_argument(
        "--config",
        type=_settings_file,
        metavar="FILE",
        help="settings that differ from the shipped cobot-setting.yaml, or the folder of such a file; other "
        "keys keep their shipped values",
    )
    run = commands.add_parser(
        "run", parents=[config], help="start the robot and the service; Ctrl-C stops both"
    )
    run.add_argument(
        "--host", metavar="H", help="address to listen on instead of web.host; 0.0.0.0 for all interfaces"
    )
    run.add_argument(
        "--port", type=_port, metavar="P", help="port to listen on instead of web.port; 0 picks a free one"
    )
    run.add_argument(
        "--clock",
        choices=["realtime", "fast"],
        help="instead of rt.clock; fast simulates motions as fast as the machine can",
    )
    options.add_sequence_options(run)
    options.add_parsers(commands)
    service = argparse.ArgumentParser(add_help=False)
    service.add_argument("--url", metavar="URL", default=options.default_url(), help=options.URL_HELP)
    service.add_argument(
        "--token",
        metavar="TOKEN",
        help="for a service that asks for one; COBOT_TOKEN tells it to fewer people",
    )
    service.add_argument(
        "--certificate", type=Path, metavar="FILE", help="of a service with https and no public certificate"
    )
    lua = commands.add_parser("lua", parents=[service], help="run a Lua program at a running service")
    lua.add_argument("file", type=Path, metavar="FILE", help="- for standard input")
    lua.add_argument("--robot", metavar="NAME", help="the robot to move, instead of the default one")
    commands.add_parser(
        "mcp", parents=[service], help="let an agent that speaks MCP over stdio use a running service"
    )
    simulate = commands.add_parser("simulate", help="run a simulated robot controller, for any client of its")
    simulate.add_argument("device", choices=list(SIMULATORS), help="fri: a KUKA LBR behind its FRI")
    simulate.add_argument(
        "options",
        nargs=argparse.REMAINDER,
        metavar="...",
        help="its own; cobot simulate fri --help lists them",
    )
    backend = commands.add_parser("backend", help="list, make and test what drives a robot")
    backend.add_argument(
        "options",
        nargs=argparse.REMAINDER,
        metavar="...",
        help="list, new NAME or test NAME; each says more with --help",
    )
    token.add_parser(commands, config)
    recording_options.add_parsers(commands)
    validate = commands.add_parser(
        "check", parents=[config], help="validate files, folders, model, limits, named positions"
    )
    validate.add_argument(
        "--hardware", action="store_true", help="and walk through the list before a real arm's first motion"
    )
    stop = commands.add_parser(
        "stop",
        parents=[config],
        help="stop every robot that runs on this computer, without the service; 0 if all are at rest",
    )
    stop.add_argument("--robot", metavar="NAME", help="only this one; with --config: only those of the file")
    stop.add_argument("--estop", action="store_true", help="latched: nothing moves until POST /robot/reset")
    remote = stop.add_argument_group("through the service of --url")
    remote.add_argument(
        "--category",
        type=int,
        choices=(options.OFF, options.HELD),
        default=options.HELD,
        help="2: held on its path (%(default)s); 1: as fast as the limits permit, then the drives go off",
    )
    options.add_service_options(remote, robot=False)
    examine = commands.add_parser("doctor", parents=[config], help="examine this computer")
    examine.add_argument("--json", action="store_true", help="as a list of objects, for programs")
    for name, text in (
        ("install", "write a systemd unit, a settings file and what belongs to them"),
        ("uninstall", "take away what install has written; your settings, logs and state stay"),
    ):
        system = commands.add_parser(name, help=text)
        system.add_argument("--dry-run", action="store_true", help="only print what would change")
        system.add_argument("--prefix", type=Path, metavar="DIR", help="write below DIR, and run nothing")
    new = commands.add_parser("new-robot", help="make the configuration of an arm from its URDF or MJCF")
    new.add_argument("file", type=Path, metavar="FILE", help="URDF or MJCF; xacro has to be expanded first")
    new.add_argument("--output", type=Path, metavar="FOLDER", help="to be made; FILE's name without it")
    new.add_argument("--actuators", nargs="+", default=[], metavar="JOINT", help="that drives move; else all")
    new.add_argument("--without", nargs="+", default=[], metavar="JOINT", help="that stay at 0, as fingers")
    new.add_argument(
        "--package", type=Path, nargs="+", default=[], metavar="FOLDER", help="where package:// is found"
    )
    new.add_argument("--base", metavar="BODY", help="the base frame")
    new.add_argument("--tcp", metavar="SITE", help="site or link that is the TCP")
    moveit = commands.add_parser("moveit-config", parents=[config], help="write a package for MoveIt 2")
    moveit.add_argument("folder", type=Path, metavar="FOLDER", help="where the package is made, as a folder")
    return parser


def _new_robot(chosen: argparse.Namespace) -> int:
    from cobot.launch.new_robot import NewRobot

    robot = NewRobot(chosen.file, chosen.actuators, chosen.without, chosen.package, chosen.base, chosen.tcp)
    folder = chosen.output or Path(chosen.file.name.split(".")[0])
    robot.write(folder)
    print(f"{folder} has been made. Guessed, to be looked at:")
    for sentence in robot.guessed:
        print(f"  {sentence}")
    print(f"Then: cobot check --config {folder} and cobot run --config {folder}")
    return EXIT_OK


def _stop(chosen: argparse.Namespace) -> int:
    """Which needs no settings, and so stops also when they cannot be read."""
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
    """Of the cobots of this user that these robots belong to, of all without a name: there is their audit."""
    from cobot.launch.running_config import RunningConfig

    found = []
    for running in RunningConfig.mine():
        with contextlib.suppress(CobotError):
            settings = load_settings(running.file)
            if not robots or not settings.each.keys().isdisjoint(robots):
                found.append(settings)
    return found


def _become_client(chosen: argparse.Namespace) -> NoReturn:
    """Become the runner or the bridge for agents: clients like any other, unknown to this library."""
    if chosen.command == "lua":
        url = address(chosen.url, chosen.robot) if chosen.robot else chosen.url
        command = [*RUN_MODULE, "sequences", "run", "--lua", "--url", url, "--", str(chosen.file)]
    else:
        command = [*RUN_MODULE, "app.mcp", "--url", chosen.url]
    given = {TOKEN_VARIABLE: chosen.token, CERTIFICATE_VARIABLE: chosen.certificate}
    os.environ.update({name: str(value) for name, value in given.items() if value is not None})
    os.execv(command[0], command)


def _settings_file(argument: str) -> Path:
    """A folder stands for the file in it that `cobot new-robot` writes."""
    file = Path(argument)
    if not file.is_dir():
        return file
    if not (file / SETTINGS_FILE).is_file():
        raise argparse.ArgumentTypeError(
            f"{argument}: has no {SETTINGS_FILE}; give the file with your settings, or a folder that "
            "`cobot new-robot` has made"
        )
    return file / SETTINGS_FILE


def _port(argument: str) -> int:
    if argument.isdecimal() and int(argument) <= 65535:
        return int(argument)
    raise argparse.ArgumentTypeError(f"{argument!r} is no port: give a number from 0 to 65535")


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
