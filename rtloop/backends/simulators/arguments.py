"""Command-line arguments that all simulated controllers accept."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rtloop.backends.addresses import an_ipv4_address
from rtloop.backends.simulators.network import MAX_DELAY

MAX_PATIENCE_S = 3600.0
MAX_PORT = 65_535
Number = TypeVar("Number", int, float)


def controller_parser(
    device: str,
    description: str | None,
    config: str = "settings file of the robot; default: the iiwa of cobot",
    address: str = "address on which it listens; default 127.0.0.1",
    default_address: str = "127.0.0.1",
    *,
    needs_config: bool = False,
) -> argparse.ArgumentParser:
    """Create a parser with the options for the robot and for the addresses.

    Args:
        config, address: help texts of these options.
    """
    parser = argparse.ArgumentParser(prog=f"cobot simulate {device}", description=description)
    add = parser.add_argument
    add("--config", type=Path, required=needs_config, metavar="FILE", help=config)
    add("--robot", metavar="NAME", help="name of a robot in `robots`")
    add("--address", type=ipv4, default=default_address, metavar="IPV4", help=address)
    add_port(parser, "--control-port", 0, "port of the control interface; 0 picks a free port")
    return parser


def add_port(parser: argparse.ArgumentParser, name: str, default: int, text: str) -> None:
    parser.add_argument(name, type=within(int, 0, MAX_PORT), default=default, metavar="P", help=text)


def add_client(parser: argparse.ArgumentParser, port: int) -> None:
    parser.add_argument(
        "--client",
        type=endpoint,
        default=("127.0.0.1", port),
        metavar="HOST:PORT",
        help=f"destination of the packets; default 127.0.0.1:{port}",
    )


def add_packet_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for faults in packets, and for the simulator that sends the packets."""
    add = parser.add_argument
    share = within(float, 0, 1)
    add("--loss", type=share, default=0.0, metavar="SHARE", help="share of packets that are lost, 0 to 1")
    add(
        "--reorder",
        type=share,
        default=0.0,
        metavar="SHARE",
        help="share of packets that arrive out of order, 0 to 1",
    )
    add(
        "--delay",
        type=within(int, 0, MAX_DELAY),
        default=0,
        metavar="N",
        help="number of periods by which answers are late",
    )
    add("--seed", type=int, default=0, metavar="N", help="seed of the random losses and order")
    add_process_options(parser, "answer")


def add_process_options(parser: argparse.ArgumentParser, message: str) -> None:
    """Add a simulator's options for its priority and its patience. `message` names what the simulator waits
    for.
    """
    add, patience = parser.add_argument, within(float, 0, MAX_PATIENCE_S)
    priority_help = "real-time priority (SCHED_FIFO), 1 to 99, if permitted"
    add("--priority", type=within(int, 1, 99), metavar="P", help=priority_help)
    add("--patience", type=patience, default=0.0, metavar="S", help=f"maximum wait for a late {message}")


def endpoint(argument: str) -> tuple[str, int]:
    host, _, port = argument.rpartition(":")
    if not (host and port.isdigit() and 0 < int(port) <= MAX_PORT):
        raise argparse.ArgumentTypeError(f"{argument!r} is not HOST:PORT with an IPv4 host")
    return host, int(port)


def ipv4(argument: str) -> str:
    try:
        return an_ipv4_address(argument)
    except ValueError as exc:
        raise argparse.ArgumentTypeError(str(exc)) from exc


def within(kind: type[Number], least: float, most: float) -> Callable[[str], Number]:
    """Create the type of an argument: a number of this kind in this range."""

    def read(argument: str) -> Number:
        try:
            value = kind(argument)
        except ValueError:
            value = None
        if value is None or not least <= value <= most:
            what = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"{argument[:80]!r} is not a {what} from {least:g} to {most:g}")
        return value

    return read
