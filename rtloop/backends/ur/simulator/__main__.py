"""`cobot simulate ur`: a controller of Universal Robots with an arm, for any client of its interfaces."""

from __future__ import annotations

import argparse
import sys

import numpy as np

from cobot.config import load_settings
from cobot.robot.description import load_robot
from rtloop.backends.simulators.arguments import MAX_PORT, add_process_options, controller_parser, within
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.process import serve
from rtloop.backends.ur import dashboard, robot_api
from rtloop.backends.ur.simulator.controller import UrController
from rtloop.backends.ur.simulator.network import DataNetwork
from rtloop.backends.ur.simulator.options import SERIES, UrControllerOptions
from rtloop.backends.ur.simulator.server import UrServer


def main() -> int:
    """Run until SIGTERM or Ctrl-C. Returns the exit status: 0, or 2 if it could not start."""
    chosen = _parser().parse_args()
    return serve(
        "ur",
        chosen,
        _server,
        lambda server: (
            f"ports {_operator_port(chosen)}, 30001, 30002 and 30004 of {chosen.address}, "
            f"control on 127.0.0.1:{server.control_port}"
        ),
    )


def _server(chosen: argparse.Namespace) -> UrServer:
    settings = load_settings(chosen.config).of(chosen.robot)
    robot = load_robot(settings)
    start = np.array(robot.positions[settings.robot.start_position].joints)
    arm = ControllerArm(settings, robot.limits, start)
    options = UrControllerOptions(
        chosen.series, chosen.on, not chosen.local, chosen.slider / 100.0, chosen.software
    )
    network = DataNetwork(chosen.seed)
    network.loss = chosen.loss
    return UrServer(
        lambda server: UrController(arm, options, server),
        chosen.address,
        chosen.control_port,
        network,
        chosen.patience,
        chosen.robot_api_port,
    )


def _operator_port(chosen: argparse.Namespace) -> int:
    return int(chosen.robot_api_port) if chosen.series == "x" else dashboard.PORT


def _version(text: str) -> tuple[int, int, int, int]:
    numbers = text.split(".")
    if not 2 <= len(numbers) <= 4 or not all(each.isdecimal() and len(each) < 7 for each in numbers):
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a version, such as 5.25.1")
    major, minor, bugfix, build = [*map(int, numbers), 0, 0][:4]
    return major, minor, bugfix, build


def _parser() -> argparse.ArgumentParser:
    config = "settings file of a robot with six joints"
    parser = controller_parser("ur", __doc__, config, needs_config=True)
    add = parser.add_argument
    add(
        "--series",
        choices=list(SERIES),
        default="e",
        help="e: 500 times per second; cb3: 125; x: PolyScope X, 500; default e",
    )
    add(
        "--software",
        type=_version,
        metavar="VERSION",
        help="version of its software, such as 5.25.1; default: 5.17.0, with cb3 3.15.8, with x 10.12.0",
    )
    add(
        "--robot-api-port",
        type=within(int, 1, MAX_PORT),
        default=robot_api.PORT,
        metavar="P",
        help="port of PolyScope X's Robot API; default 80, which needs root",
    )
    add("--on", action="store_true", help="start with the arm switched on and its brakes released")
    add(
        "--local", action="store_true", help="start in Local Control, which rejects programs from the network"
    )
    add(
        "--slider",
        type=within(float, 0, 100),
        default=100.0,
        metavar="PERCENT",
        help="speed slider; default 100",
    )
    add(
        "--loss",
        type=within(float, 0, 1),
        default=0.0,
        metavar="SHARE",
        help="share of data packages that are left out, 0 to 1",
    )
    add("--seed", type=int, default=0, metavar="N", help="seed of the random losses")
    add_process_options(parser, "command")
    return parser


if __name__ == "__main__":
    sys.exit(main())
