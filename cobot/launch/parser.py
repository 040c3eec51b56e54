"""What the `cobot` command understands: every command with its options."""

from __future__ import annotations

import argparse
import contextlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cobot.commands import options
from cobot.config import SETTINGS_FILE
from cobot.launch import backup_options, recording_options, token

DESCRIPTION = """\
A robot arm behind a REST service.

  cobot run      start the simulated (or real) robot and the service, and watch over both
  cobot run FILE    run a sequence (.json) or program (.lua) at the service that runs, see docs/cli.md
  cobot state, move, send, jobs, watch, teleop   use a service that runs, see docs/cli.md
  cobot acknowledge   let a real robot move faster after a first look at it, see docs/safety.md
  cobot check    validate the whole configuration, without starting anything
  cobot simulate fri   a simulated robot controller for any client of KUKA's FRI, see docs/kuka-fri.md
  cobot simulate robotiq   a simulated gripper for any client of Robotiq's, see docs/grippers.md
  cobot backend  list, make and test what drives a robot, see docs/your-backend.md
  cobot gripper  list, make and test what drives a gripper, see docs/your-gripper.md
  cobot new-robot   make the configuration of another arm from its URDF or MJCF, see docs/your-robot.md
  cobot study    answer a question that needs thousands of computations, see docs/studies.md
  cobot fleet    all cells of a plant on one page, with one stop for all, see docs/fleet.md
  cobot stop     bring every arm of this computer to rest, whatever has become of the service
  cobot moveit-config   write a package with which MoveIt 2 plans for the robot, see docs/ros2.md
  cobot lua      run a Lua program at a running service, see docs/lua.md
  cobot record   write down what the robot did or does; cobot plot draws it, cobot replay moves the arm again
  cobot mcp      let an agent that speaks MCP over stdio use a running service, see docs/mcp.md
  cobot token    make, list and revoke the tokens that a service on the network asks for
  cobot backup   write what people have set up to one file; cobot restore takes it back
  cobot support  write versions, health, logs and settings without secrets to one file
  cobot doctor   whether this computer is fit for it, and what to type where it is not
  cobot completion  print what makes bash, zsh or fish complete commands
  cobot install  make it a service of systemd; cobot uninstall takes that back

The first run needs no configuration: open http://localhost:8007 and move the arm."""

SIMULATORS = {"fri": "rtloop.backends.fri.simulator", "robotiq": "cobot.grippers.robotiq.simulator"}
"""Modules of what `cobot simulate` runs; each knows its own options."""


def make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "cobot", description=DESCRIPTION, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"cobot {version('cobot')}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    config = _config()
    _add_run(commands, config)
    options.add_parsers(commands)
    _add_clients(commands)
    _add_simulate_and_backend(commands)
    token.add_parser(commands, config)
    backup_options.add_parsers(commands, config)
    recording_options.add_parsers(commands)
    _add_check(commands, config)
    _add_stop(commands, config)
    _add_doctor_and_install(commands, config)
    _add_new_robot(commands)
    _add_moveit(commands, config)
    return parser


def _config() -> argparse.ArgumentParser:
    config = argparse.ArgumentParser(add_help=False)
    config.add_argument(
        "--config",
        type=_settings_file,
        metavar="FILE",
        help="settings that differ from the shipped cobot-setting.yaml, or the folder of such a file; other "
        "keys keep their shipped values",
    )
    return config


def _add_run(commands: Any, config: argparse.ArgumentParser) -> None:
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
    run.add_argument(
        "--cell",
        type=Path,
        metavar="FILE",
        help="simulate this cell instead of robot.cell: a cell file, or a folder with a cell.yaml",
    )
    options.add_sequence_options(run)


def _add_clients(commands: Any) -> None:
    """What becomes a client of a running service."""
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


def _add_simulate_and_backend(commands: Any) -> None:
    simulate = commands.add_parser("simulate", help="run a simulated robot controller, for any client of its")
    simulate.add_argument(
        "device", choices=list(SIMULATORS), help="fri: a KUKA LBR behind its FRI; robotiq: a gripper"
    )
    simulate.add_argument(
        "options",
        nargs=argparse.REMAINDER,
        metavar="...",
        help="its own; cobot simulate fri --help lists them",
    )
    study = commands.add_parser("study", help="answer a question that needs thousands of computations")
    study.add_argument(
        "options",
        nargs=argparse.REMAINDER,
        metavar="...",
        help="FILE.yaml or show FOLDER; each says more with --help",
    )
    fleet = commands.add_parser("fleet", help="show and stop the cells of a fleet, or run its hub")
    fleet.add_argument(
        "options",
        nargs=argparse.REMAINDER,
        metavar="...",
        help="serve, list, show, watch or stop; each says more with --help",
    )
    for name, text in (
        ("backend", "list, make and test what drives a robot"),
        ("gripper", "list, make and test what drives a gripper"),
    ):
        devices = commands.add_parser(name, help=text)
        devices.add_argument(
            "options",
            nargs=argparse.REMAINDER,
            metavar="...",
            help="list, new NAME or test NAME; each says more with --help",
        )


def _add_check(commands: Any, config: argparse.ArgumentParser) -> None:
    validate = commands.add_parser(
        "check", parents=[config], help="validate files, folders, model, limits, named positions"
    )
    validate.add_argument(
        "--hardware", action="store_true", help="and walk through the list before a real arm's first motion"
    )


def _add_stop(commands: Any, config: argparse.ArgumentParser) -> None:
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


def _add_doctor_and_install(commands: Any, config: argparse.ArgumentParser) -> None:
    examine = commands.add_parser("doctor", parents=[config], help="examine this computer")
    examine.add_argument("--json", action="store_true", help="as a list of objects, for programs")
    for name, text in (
        ("install", "write a systemd unit, a settings file and what belongs to them"),
        ("uninstall", "take away what install has written; your settings, logs and state stay"),
    ):
        system = commands.add_parser(name, help=text)
        system.add_argument("--dry-run", action="store_true", help="only print what would change")
        system.add_argument("--prefix", type=Path, metavar="DIR", help="write below DIR, and run nothing")


def _add_new_robot(commands: Any) -> None:
    new = commands.add_parser("new-robot", help="make the configuration of an arm from its URDF or MJCF")
    new.add_argument("file", type=Path, metavar="FILE", help="URDF, xacro or MJCF")
    new.add_argument("--output", type=Path, metavar="FOLDER", help="to be made; FILE's name without it")
    new.add_argument(
        "--actuators",
        nargs="+",
        action="extend",
        default=[],
        metavar="JOINT",
        help="that drives move; else those of the arm",
    )
    new.add_argument(
        "--without",
        nargs="+",
        action="extend",
        default=[],
        metavar="JOINT",
        help="that are not part of the arm",
    )
    new.add_argument(
        "--package",
        type=Path,
        nargs="+",
        action="extend",
        default=[],
        metavar="FOLDER",
        help="where ROS packages are found",
    )
    new.add_argument(
        "--xacro",
        type=_xacro_argument,
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME:=VALUE",
        help="arguments of a xacro file",
    )
    new.add_argument(
        "--hulls", action="store_true", help="take the convex hull of each mesh, never several solids"
    )
    new.add_argument(
        "--skip-missing-meshes",
        action="store_true",
        help="leave out shapes whose mesh does not exist; nothing keeps them from touching",
    )
    new.add_argument("--base", metavar="BODY", help="the base frame")
    new.add_argument(
        "--tcp", metavar="SITE", help="site or link that is the TCP; chooses one of several arms"
    )
    new.add_argument("--srdf", type=Path, metavar="FILE", help="groups, states and pairs that may touch")
    new.add_argument("--group", metavar="NAME", help="the group of the SRDF whose joints drives move")
    new.add_argument(
        "--density",
        type=float,
        metavar="KG_PER_M3",
        help="of links without <inertial>, instead of 1100 kg/m³",
    )
    new.add_argument(
        "--mass",
        type=_mass,
        nargs="+",
        action="extend",
        default=[],
        metavar="LINK=KG",
        help="mass of a link, instead of the file's or an assumed one",
    )


def _add_moveit(commands: Any, config: argparse.ArgumentParser) -> None:
    moveit = commands.add_parser("moveit-config", parents=[config], help="write a package for MoveIt 2")
    moveit.add_argument("folder", type=Path, metavar="FOLDER", help="where the package is made, as a folder")


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


def _mass(argument: str) -> tuple[str, float]:
    link, equals, mass = argument.rpartition("=")
    with contextlib.suppress(ValueError):
        if link and equals:
            return link, float(mass)
    raise argparse.ArgumentTypeError(f"{argument!r} is not LINK=KG, such as upper_arm=3.5")


def _xacro_argument(argument: str) -> tuple[str, str]:
    name, assigned, value = argument.partition(":=")
    if name and assigned:
        return name, value
    raise argparse.ArgumentTypeError(f"{argument!r} is not NAME:=VALUE, such as ur_type:=ur5e")


def _port(argument: str) -> int:
    if argument.isdecimal() and int(argument) <= 65535:
        return int(argument)
    raise argparse.ArgumentTypeError(f"{argument!r} is not a port: give a number from 0 to 65535")
