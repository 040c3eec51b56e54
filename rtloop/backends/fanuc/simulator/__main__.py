"""`cobot simulate fanuc`: a controller with an arm, for any client of Stream Motion and the Remote Motion
Interface.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from cobot.config import load_settings
from cobot.robot.description import load_robot
from rtloop.backends.fanuc.messages import FORCE_VERSION, MIN_VERSION, PORT
from rtloop.backends.fanuc.options import RMI_PORT, an_io_point
from rtloop.backends.fanuc.simulator.controller import FanucController
from rtloop.backends.fanuc.simulator.network import FanucNetwork
from rtloop.backends.fanuc.simulator.options import MODES, FanucControllerOptions
from rtloop.backends.fanuc.simulator.server import ControllerServer
from rtloop.backends.simulators.arguments import add_packet_options, add_port, controller_parser, within
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.process import serve

PERIODS_MS = (1, 2, 4, 8)
MAX_LAG_MS = 1000


def main() -> int:
    """Run until SIGTERM or Ctrl-C. Returns the exit status: 0, or 2 if it could not start."""
    chosen = _parser().parse_args()
    return serve(
        "fanuc",
        chosen,
        _server,
        lambda server: (
            f"UDP {chosen.address}:{server.port}, every {chosen.period} ms, "
            f"TCP {chosen.address}:{server.rmi.port}, control on 127.0.0.1:{server.control_port}"
        ),
    )


def _server(chosen: argparse.Namespace) -> ControllerServer:
    settings = load_settings(chosen.config).of(chosen.robot)
    robot = load_robot(settings)
    options = FanucControllerOptions(
        period_ms=chosen.period,
        version=chosen.version,
        mode=chosen.mode,
        horizon=chosen.horizon,
        payload_share=chosen.payload,
        table_share=chosen.table,
        io=dict(chosen.io),
        lag_ms=chosen.lag,
        world_z_m=chosen.world_z,
    )
    start = np.array(robot.positions[settings.robot.start_position].joints)
    arm = ControllerArm(settings, robot.limits, start)
    return ControllerServer(
        FanucController(arm, options),
        FanucNetwork(chosen.seed, chosen.loss, chosen.reorder, chosen.delay),
        address=chosen.address,
        stream_port=chosen.stream_port,
        rmi_port=chosen.rmi_port,
        control_port=chosen.control_port,
        patience_s=chosen.patience,
    )


def _parser() -> argparse.ArgumentParser:
    parser = controller_parser("fanuc", __doc__)
    add = parser.add_argument
    add_port(parser, "--stream-port", PORT, f"UDP port of the stream; default {PORT}; 0 picks a free port")
    rmi_help = f"TCP port of the Remote Motion Interface; default {RMI_PORT}; 0 picks a free port"
    add_port(parser, "--rmi-port", RMI_PORT, rmi_help)
    add(
        "--period",
        type=int,
        choices=PERIODS_MS,
        default=8,
        metavar="MS",
        help="send period, 1, 2, 4 or 8 ms; default 8",
    )
    add("--version", type=int, choices=range(1, FORCE_VERSION + 1), default=MIN_VERSION, help=VERSION_HELP)
    add("--mode", choices=MODES, default="AUTO", help="operation mode; default AUTO")
    add("--horizon", action="store_true", help="joint 3 of the stream is measured from the horizon")
    add(
        "--payload",
        type=within(float, 0, 1),
        default=0.0,
        metavar="SHARE",
        help="payload as a share of the full payload; default 0",
    )
    add("--table", type=within(float, 0.01, 10), default=1.0, metavar="SHARE", help=TABLE_HELP)
    add(
        "--io",
        type=_io,
        action="append",
        default=[],
        metavar="NAME[=VALUE]",
        help="an input or output, such as DO[1]=1",
    )
    add(
        "--lag",
        type=within(int, 0, MAX_LAG_MS),
        default=0,
        metavar="MS",
        help="delay of the reported joints; default 0",
    )
    add("--world-z", type=within(float, -10, 10), default=0.0, metavar="M", help=WORLD_HELP)
    add_packet_options(parser)
    return parser


VERSION_HELP = "version of Stream Motion; default 3. The backend needs 3 or more"
TABLE_HELP = "limits at full payload and speed, as a share of the model's; default 1"
WORLD_HELP = "height of the world frame above the model's base; default 0"


def _io(argument: str) -> tuple[str, int]:
    name, _, value = argument.partition("=")
    try:
        number = int(value or 0)
        found = an_io_point(name)
    except ValueError as exc:
        raise argparse.ArgumentTypeError(f"{argument[:80]!r} is not NAME[=VALUE], such as DO[1]=1") from exc
    most = 0xFFFF if name.startswith("A") else 1
    if not 0 <= number <= most:
        raise argparse.ArgumentTypeError(f"{argument[:80]!r}: the value must be from 0 to {most}")
    return found, number


if __name__ == "__main__":
    sys.exit(main())
