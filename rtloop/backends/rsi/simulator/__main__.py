"""`cobot simulate rsi`: a controller of a KUKA KR robot with RSI, for any client."""

from __future__ import annotations

import argparse
import sys

import numpy as np

from cobot.config import load_settings
from cobot.robot.description import load_robot
from rtloop.backends.rsi.options import DEFAULT_PORT, RsiOptions
from rtloop.backends.rsi.simulator.control import RsiControlServer
from rtloop.backends.rsi.simulator.controller import RsiController
from rtloop.backends.rsi.simulator.lockstep import controller_for, with_options
from rtloop.backends.rsi.simulator.network import RsiNetwork
from rtloop.backends.rsi.simulator.options import PERIODS_MS, ControllerOptions
from rtloop.backends.rsi.telegrams import OPERATION_MODES
from rtloop.backends.simulators.arguments import (
    add_client,
    add_packet_options,
    add_port,
    controller_parser,
    within,
)
from rtloop.backends.simulators.process import serve
from rtloop.backends.simulators.udp_server import UdpServer


def main() -> int:
    """Run until SIGTERM or Ctrl-C. Returns the exit status: 0, or 2 if it could not start."""
    chosen = _parser().parse_args()
    return serve(
        "rsi",
        chosen,
        _server,
        lambda server: (
            f"from {chosen.address}:{server.port} to {chosen.client[0]}:{chosen.client[1]} "
            f"every {server.period_ms} ms, control on 127.0.0.1:{server.control_port}"
        ),
    )


def _server(chosen: argparse.Namespace) -> UdpServer[RsiController]:
    settings = load_settings(chosen.config).of(chosen.robot)
    if settings.robot.backend.type != "rsi":
        settings = with_options(settings.model_copy(), **_options_without_backend())
    robot = load_robot(settings)
    own = settings.backend_options(RsiOptions) or RsiOptions()
    period_ms = round(settings.rt.period_s * 1e3)
    relative = own.correction == "relative"
    options = ControllerOptions(
        chosen.period or (period_ms if period_ms in PERIODS_MS else PERIODS_MS[0]),
        relative,
        not relative if chosen.hold_on is None else chosen.hold_on == "1",
        chosen.timeout or own.timeout_packets,
        chosen.in_a_row,
        chosen.mode,
        chosen.override,
        not chosen.plain,
    )
    start = np.array(robot.positions[settings.robot.start_position].joints)
    controller = controller_for(settings, robot.limits, options, start)
    return UdpServer(
        controller,
        RsiNetwork(controller.layout, chosen.seed, chosen.loss, chosen.reorder, chosen.delay),
        chosen.client,
        RsiControlServer,
        address=(chosen.address, chosen.port),
        control_port=chosen.control_port,
        patience_s=chosen.patience,
    )


def _options_without_backend() -> dict[str, object]:
    """Create options for an arm whose settings name a different backend. Corrections are practically
    unlimited, so that only the arm's own limits apply.
    """
    return {"max_correction": 360.0}


def _parser() -> argparse.ArgumentParser:
    config = "settings file with the arm and `robot.backend: {type: rsi, ...}`"
    address = "address from which packets are sent; default 127.0.0.1"
    parser = controller_parser("rsi", __doc__, config, address)
    add = parser.add_argument
    add_client(parser, DEFAULT_PORT)
    add_port(parser, "--port", 0, "port from which packets are sent; 0 picks a free port")
    add(
        "--period",
        type=int,
        choices=PERIODS_MS,
        help="send period: 12 ms (IPO) or 4 ms (IPO_FAST); default: the value in the settings, otherwise 4",
    )
    add("--timeout", type=within(int, 1, 10_000), metavar="N", help="number of late answers that are allowed")
    add("--in-a-row", action="store_true", help="--timeout counts only consecutive late answers")
    add(
        "--hold-on",
        choices=["0", "1"],
        help="HOLDON of the corrections; default: 1 for absolute corrections, 0 for relative ones",
    )
    add("--mode", choices=OPERATION_MODES, default="AUT", help="operation mode; default AUT")
    add(
        "--override",
        type=within(int, 0, 100),
        default=100,
        metavar="PERCENT",
        help="program override; default 100",
    )
    add(
        "--plain", action="store_true", help="report neither mode, state, override nor the sum of corrections"
    )
    add_packet_options(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
