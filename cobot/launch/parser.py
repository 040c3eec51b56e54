"""The command line of `cobot`: every command with its options."""

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
  cobot run FILE    run a sequence (.json) or program (.lua) at a running service, see docs/cli.md
  cobot state, move, send, jobs, watch, teleop   use a running service, see docs/cli.md
  cobot acknowledge   let a real robot move faster, once you have inspected it, see docs/safety.md
  cobot check    validate the whole configuration, without starting anything
  cobot simulate fanuc   a simulated controller for any client of Stream Motion, see docs/fanuc.md
  cobot simulate ros2_control   the controllers of an arm, for any client with ROS 2, see docs/ros2-control.md
  cobot simulate fri   a simulated robot controller for any client of KUKA's FRI, see docs/kuka-fri.md
  cobot simulate rsi   a simulated controller of a KUKA KR for any client of RSI, see docs/kuka-rsi.md
  cobot simulate robotiq   a simulated gripper for any client of Robotiq's, see docs/grippers.md
  cobot simulate ur   a simulated controller for any client of Universal Robots, see docs/ur.md
  cobot backend  list, create and test robot drivers (backends), see docs/your-backend.md
  cobot gripper  list, create and test gripper drivers, see docs/your-gripper.md
  cobot new-robot   make the configuration of another arm from its URDF or MJCF, see docs/your-robot.md
  cobot study    answer a question that needs thousands of computations, see docs/studies.md
  cobot fleet    all cells of a plant on one page, with one stop for all, see docs/fleet.md
  cobot stop     stop every arm of this computer, even if the service has crashed or is overloaded
  cobot moveit-config   write a package with which MoveIt 2 plans for the robot, see docs/ros2.md
  cobot lua      run a Lua program at a running service, see docs/lua.md
  cobot record   record the motion of the robot; cobot plot draws a recording, cobot replay repeats it
  cobot mcp      let an agent that speaks MCP over stdio use a running service, see docs/mcp.md
  cobot token    make, list and revoke the tokens that a service on the network asks for
  cobot backup   write the configuration and the programs to one file; cobot restore restores them
  cobot support  write versions, health, logs and settings without secrets to one file
  cobot doctor   check whether this computer suits real-time control, and print commands that help
  cobot completion  print a script with which bash, zsh or fish complete commands
  cobot install  install cobot as a systemd service; cobot uninstall removes the service

The first run needs no configuration: open http://localhost:8007 and move the arm."""

SIMULATORS = {
    "fanuc": "rtloop.backends.fanuc.simulator",
    "ros2_control": "cobot.dds.controller_simulator",
    "fri": "rtloop.backends.fri.simulator",
    "rsi": "rtloop.backends.rsi.simulator",
    "robotiq": "cobot.grippers.robotiq.simulator",
    "ur": "rtloop.backends.ur.simulator",
}
"""Modules that `cobot simulate` runs. Each defines its own options."""
MODULES = {
    "study": "cobot.studies.__main__",
    "fleet": "cobot.fleet.__main__",
    "backend": "rtloop.contract.__main__",
    "gripper": "cobot.grippers.contract.__main__",
}
"""Modules of the commands that read their own options."""


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
        help="file with the settings that differ from the defaults, or the folder of such a file",
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
        help="clock to use instead of rt.clock; fast simulates motions as fast as the computer can",
    )
    run.add_argument(
        "--cell",
        type=Path,
        metavar="FILE",
        help="simulate this cell instead of robot.cell: a cell file, or a folder with a cell.yaml",
    )
    options.add_sequence_options(run)


def _add_clients(commands: Any) -> None:
    """Add the commands that are clients of a running service."""
    service = options.service_options(robot=False, as_json=False)
    lua = commands.add_parser("lua", parents=[service], help="run a Lua program at a running service")
    lua.add_argument("file", type=Path, metavar="FILE", help="the Lua program; - for standard input")
    lua.add_argument("--robot", metavar="NAME", help="the robot to move, instead of the default one")
    commands.add_parser(
        "mcp", parents=[service], help="let an agent that speaks MCP over stdio use a running service"
    )


def _add_simulate_and_backend(commands: Any) -> None:
    simulate = commands.add_parser("simulate", help="run a simulated robot controller or gripper")
    simulate.add_argument(
        "device",
        choices=list(SIMULATORS),
        help="fanuc: its arms; fri: a KUKA LBR with its FRI; rsi: a KUKA KR with its RSI; robotiq: a "
        "gripper; ros2_control: the controllers of an arm with ROS 2; ur: arms of Universal Robots",
    )
    simulate.add_argument(
        "options",
        nargs=argparse.REMAINDER,
        metavar="...",
        help="options of the simulator; cobot simulate fri --help lists them",
    )
    for name, text in (
        ("study", "answer a question that needs thousands of computations"),
        ("fleet", "show and stop the cells of a fleet, or run its hub"),
        ("backend", "list, create and test robot drivers (backends)"),
        ("gripper", "list, create and test gripper drivers"),
    ):
        commands.add_parser(name, help=text)


def _add_check(commands: Any, config: argparse.ArgumentParser) -> None:
    validate = commands.add_parser(
        "check", parents=[config], help="validate files, folders, model, limits, named positions"
    )
    validate.add_argument(
        "--hardware", action="store_true", help="also print the checklist for the first motion of a real arm"
    )


def _add_stop(commands: Any, config: argparse.ArgumentParser) -> None:
    stop = commands.add_parser(
        "stop",
        parents=[config],
        help="stop every robot on this computer, without the service; exit status 0 if all are at rest",
    )
    stop.add_argument(
        "--robot", metavar="NAME", help="stop only this robot; with --config, only those of the file"
    )
    stop.add_argument(
        "--estop", action="store_true", help="latch the stop: nothing moves until POST /robot/reset"
    )
    remote = stop.add_argument_group("stop through the service at --url")
    remote.add_argument(
        "--category",
        type=int,
        choices=(options.OFF, options.HELD),
        default=options.HELD,
        help="2: stop on the path, drives stay on (%(default)s); 1: stop as fast as the limits permit, "
        "then drives off",
    )
    options.add_service_options(remote, robot=False)


def _add_doctor_and_install(commands: Any, config: argparse.ArgumentParser) -> None:
    examine = commands.add_parser(
        "doctor", parents=[config], help="check whether this computer suits real-time control"
    )
    examine.add_argument("--json", action="store_true", help="print the findings as JSON, for programs")
    for name, text in (
        ("install", "install cobot as a systemd service, with a settings file"),
        ("uninstall", "remove the systemd service; your settings, logs and state stay"),
    ):
        system = commands.add_parser(name, help=text)
        system.add_argument("--dry-run", action="store_true", help="only print what would change")
        system.add_argument(
            "--prefix", type=Path, metavar="DIR", help="write the files below DIR, and run no commands"
        )


def _add_new_robot(commands: Any) -> None:
    several: dict[str, Any] = {"nargs": "+", "action": "extend", "default": []}
    new = commands.add_parser("new-robot", help="make the configuration of an arm from its URDF or MJCF")
    source = new.add_mutually_exclusive_group(required=True)
    source.add_argument("file", type=Path, nargs="?", metavar="FILE", help="URDF, xacro or MJCF")
    source.add_argument(
        "--ros",
        metavar="NAMESPACE",
        help="read NAMESPACE/robot_description of a running ROS 2 instead of a file; / for no namespace",
    )
    new.add_argument(
        "--output", type=Path, metavar="FOLDER", help="folder to create; by default the name of FILE"
    )
    new.add_argument(
        "--actuators", **several, metavar="JOINT", help="joints that drives move; by default those of the arm"
    )
    new.add_argument("--without", **several, metavar="JOINT", help="joints that are not part of the arm")
    new.add_argument(
        "--package",
        type=Path,
        **several,
        metavar="FOLDER",
        help="folder of a ROS package, or a folder that contains packages",
    )
    new.add_argument(
        "--xacro", type=_xacro_argument, **several, metavar="NAME:=VALUE", help="arguments of a xacro file"
    )
    new.add_argument(
        "--hulls", action="store_true", help="use one convex hull for each mesh, never several solids"
    )
    new.add_argument(
        "--skip-missing-meshes",
        action="store_true",
        help="leave out shapes whose mesh does not exist; their collisions are not detected",
    )
    new.add_argument("--base", metavar="BODY", help="body that becomes the base frame")
    new.add_argument(
        "--tcp", metavar="SITE", help="site or link that becomes the TCP; selects one of several arms"
    )
    new.add_argument(
        "--srdf", type=Path, metavar="FILE", help="SRDF with groups, states and pairs of links that may touch"
    )
    new.add_argument("--group", metavar="NAME", help="group of the SRDF whose joints the drives move")
    new.add_argument(
        "--density",
        type=float,
        metavar="KG_PER_M3",
        help="density of links without <inertial>, instead of 1100 kg/m³",
    )
    new.add_argument(
        "--mass",
        type=_mass,
        **several,
        metavar="LINK=KG",
        help="mass of a link, instead of the mass in the file or an assumed mass",
    )


def _add_moveit(commands: Any, config: argparse.ArgumentParser) -> None:
    moveit = commands.add_parser("moveit-config", parents=[config], help="write a package for MoveIt 2")
    moveit.add_argument("folder", type=Path, metavar="FOLDER", help="folder in which the package is created")


def _settings_file(argument: str) -> Path:
    """The settings file that an option names. For a folder, it is the file in that folder that `cobot
    new-robot` writes.
    """
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
