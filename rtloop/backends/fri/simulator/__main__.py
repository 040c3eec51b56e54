"""`cobot simulate fri`: a cabinet with an arm, for any client of FRI."""

from __future__ import annotations

import argparse
import sys

import numpy as np

from cobot.config import load_settings
from cobot.errors import LimitError
from cobot.robot.description import load_robot
from cobot.robot.io_points import require_number
from rtloop.backends.fri.messages import (
    MAX_NAME,
    CommandMode,
    ControlMode,
    IoDirection,
    IoType,
    IoValue,
    OperationMode,
)
from rtloop.backends.fri.outputs import point_of
from rtloop.backends.fri.simulator.cabinet import Cabinet
from rtloop.backends.fri.simulator.control import ControlServer
from rtloop.backends.fri.simulator.network import FriNetwork
from rtloop.backends.fri.simulator.options import NEEDED_CONTROL, CabinetOptions
from rtloop.backends.simulators.arguments import add_client, add_packet_options, add_port, controller_parser
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.process import serve
from rtloop.backends.simulators.udp_server import UdpServer

OVERLAYS = {
    "position": CommandMode.POSITION,
    "wrench": CommandMode.WRENCH,
    "torque": CommandMode.TORQUE,
}
CONTROLS = {
    "position": ControlMode.POSITION,
    "joint-impedance": ControlMode.JOINT_IMPEDANCE,
    "cartesian-impedance": ControlMode.CARTESIAN_IMPEDANCE,
}


def main() -> int:
    """Run until SIGTERM or Ctrl-C. Returns the exit status: 0, or 2 if it could not start."""
    parser = _parser()
    chosen = parser.parse_args()
    needed = NEEDED_CONTROL.get(OVERLAYS[chosen.overlay])
    if chosen.control_mode and needed not in (None, CONTROLS[chosen.control_mode]):
        needs = next(name for name, control in CONTROLS.items() if control == needed)
        parser.error(f"--overlay {chosen.overlay} needs --control-mode {needs}, got {chosen.control_mode}")
    return serve(
        "fri",
        chosen,
        _server,
        lambda server: (
            f"from {chosen.address}:{server.port} to {chosen.client[0]}:{chosen.client[1]} "
            f"every {server.period_ms} ms, control on 127.0.0.1:{server.control_port}"
        ),
    )


def _server(chosen: argparse.Namespace) -> UdpServer[Cabinet]:
    settings = load_settings(chosen.config).of(chosen.robot)
    robot = load_robot(settings)
    mode = OVERLAYS[chosen.overlay]
    options = CabinetOptions(
        chosen.period if chosen.period is not None else round(settings.rt.period_s * 1e3),
        chosen.multiplier,
        chosen.version if "." in chosen.version else f"{chosen.version}.x",
        OperationMode[chosen.mode],
        mode,
        CONTROLS[chosen.control_mode]
        if chosen.control_mode
        else NEEDED_CONTROL.get(mode, ControlMode.POSITION),
        tuple(chosen.io),
    )
    start = np.array(robot.positions[settings.robot.start_position].joints)
    cabinet = Cabinet(ControllerArm(settings, robot.limits, start, options.springs), options)
    network = FriNetwork(chosen.seed, chosen.loss, chosen.reorder, chosen.delay)
    return UdpServer(
        cabinet,
        network,
        chosen.client,
        ControlServer,
        address=(chosen.address, chosen.port),
        control_port=chosen.control_port,
        patience_s=chosen.patience,
    )


def _parser() -> argparse.ArgumentParser:
    address = "address of this computer from which packets are sent"
    parser = controller_parser("fri", __doc__, address=address, default_address="0.0.0.0")
    add = parser.add_argument
    add_client(parser, 30200)
    add_port(parser, "--port", 0, PORT_HELP)
    add(
        "--period",
        type=int,
        metavar="MS",
        help="send period, 1 to 100 ms; default: rt.period_s of the settings",
    )
    add(
        "--multiplier",
        type=int,
        default=1,
        metavar="N",
        help="an answer is expected every N messages; default 1",
    )
    add("--version", choices=["1", "2", "2.7"], default="1", help=VERSION_HELP)
    add(
        "--mode",
        choices=[each.name for each in OperationMode],
        default="AUT",
        help="operation mode; default AUT",
    )
    add(
        "--overlay",
        choices=list(OVERLAYS),
        default="position",
        help="command type of its program; default position",
    )
    add(
        "--control-mode",
        choices=list(CONTROLS),
        help="control mode of the drives; default: as the overlay requires",
    )
    add("--io", type=_io, action="append", default=[], metavar="NAME:TYPE:WAY[=VALUE]", help=IO_HELP)
    add_packet_options(parser)
    return parser


VERSION_HELP = "version of FRI: 1 for 1.11 to 1.17, 2 for 2.x before 2.7, or 2.7; default 1"
PORT_HELP = (
    "port from which packets are sent; 0: the client's port number if the client has another address, "
    "otherwise a free one"
)
IO_HELP = (
    "an input or output, as the cabinet sees it, of the type boolean, digital or analog; "
    "such as Tool.Open:boolean:output=1"
)


def _io(argument: str) -> IoValue:
    what, _, value = argument.partition("=")
    name, kind, way = ([*what.split(":"), "", ""])[:3]
    try:
        found = IoValue(name, IoType[kind.upper()], IoDirection[way.upper()], float(value or 0.0))
    except (KeyError, ValueError) as exc:
        raise argparse.ArgumentTypeError(f"{argument!r} is not NAME:TYPE:WAY[=VALUE]") from exc
    if not 0 < len(name.encode()) <= MAX_NAME:
        raise argparse.ArgumentTypeError(f"{argument!r}: a name has 1 to {MAX_NAME} bytes")
    try:
        require_number(point_of(found), found.value)
    except LimitError as exc:
        raise argparse.ArgumentTypeError(f"{argument!r}: {exc}") from exc
    return found


if __name__ == "__main__":
    sys.exit(main())
