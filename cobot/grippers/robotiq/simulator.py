"""`cobot simulate robotiq`: a simulated gripper on a pseudo terminal and over TCP, for any client."""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import signal
import socket
import sys
import threading
import time
import tty
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cobot.grippers.robotiq.registers import MODELS
from cobot.grippers.robotiq.slave import Fingers, Slave
from cobot.grippers.robotiq.text_slave import TextSlave
from cobot.grippers.robotiq.urcap import PORT as URCAP_PORT

PORT = 54321
MAX_CLIENTS = 8
SEND_S = 1.0
"""Time after which a client that does not read its answers is disconnected, s."""


class Simulator:
    """The gripper and its connections, served by a thread until it is closed.

    Attributes:
        slave: the gripper.
        device: path of the pseudo terminal.
        port: TCP port of RTU over TCP.
        urcap_port: TCP port of the URCap's text protocol.
        late_s: additional delay of each answer, for tests.
    """

    def __init__(
        self,
        model: str = "2f85",
        unit: int = 9,
        host: str = "127.0.0.1",
        port: int = 0,
        link: Path | None = None,
        urcap_port: int = 0,
    ) -> None:
        self.slave = Slave(Fingers(model, time.monotonic), unit)
        self.late_s = 0.0
        # The ports come first: if one is in use, nothing needs cleaning up.
        self._listener = socket.create_server((host, port))
        try:
            self._urcap = socket.create_server((host, urcap_port))
        except (OSError, OverflowError):
            self._listener.close()
            raise
        self.port: int = self._listener.getsockname()[1]
        self.urcap_port: int = self._urcap.getsockname()[1]
        self._terminal, self._other = os.openpty()
        os.set_blocking(self._terminal, False)  # unread data are lost, as on a serial line
        tty.setraw(self._other)  # stays open, so that a client that disconnects does not end the terminal
        self.device = os.ttyname(self._other)
        self._link = link
        if link is not None:
            if link.is_symlink():
                link.unlink()
            link.symlink_to(self.device)
            self.device = str(link)
        self._clients: list[tuple[socket.socket, Slave | TextSlave]] = []
        self._wake, self._woken = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="robotiq", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the simulator. Its clients are disconnected."""
        os.write(self._woken, b"x")
        self._thread.join()
        for each in (*(client for client, _ in self._clients), self._listener, self._urcap):
            each.close()
        for number in (self._terminal, self._other, self._wake, self._woken):
            os.close(number)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def _serve(self) -> None:
        while True:
            sockets = [client for client, _ in self._clients]
            waiting: list[Any] = [self._wake, self._terminal, self._listener, self._urcap, *sockets]
            ready, _, _ = select.select(waiting, [], [])
            if self._wake in ready:
                return
            if self._terminal in ready:
                with contextlib.suppress(BlockingIOError):
                    os.write(self._terminal, self._answer(self.slave, os.read(self._terminal, 256)))
            for each in [each for each in self._clients if each[0] in ready]:
                self._serve_client(*each)
            if self._listener in ready:
                self._accept(self._listener, self.slave)
            if self._urcap in ready:
                self._accept(self._urcap, TextSlave(self.slave))

    def _accept(self, listener: socket.socket, slave: Slave | TextSlave) -> None:
        client, _ = listener.accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.settimeout(SEND_S)
        self._clients.append((client, slave))
        if len(self._clients) > MAX_CLIENTS:
            self._clients.pop(0)[0].close()

    def _serve_client(self, client: socket.socket, slave: Slave | TextSlave) -> None:
        data = b""
        with contextlib.suppress(OSError):
            data = client.recv(256)
            if data:
                client.sendall(self._answer(slave, data))
                return
        client.close()
        self._clients.remove((client, slave))

    def _answer(self, slave: Slave | TextSlave, data: bytes) -> bytes:
        answer = slave.feed(data)
        if self.late_s:
            time.sleep(self.late_s)
        return answer


@contextlib.contextmanager
def run_simulator(model: str = "2f85", **how: object) -> Iterator[Simulator]:
    """Context manager that provides a simulated gripper until it ends."""
    made = Simulator(model, **how)  # type: ignore[arg-type]
    try:
        yield made
    finally:
        made.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate a gripper until Ctrl-C."""
    parser = argparse.ArgumentParser(
        "cobot simulate robotiq", description="Simulate a Robotiq gripper, see docs/grippers.md."
    )
    parser.add_argument(
        "--model", choices=list(MODELS), default="2f85", help="model of the gripper (%(default)s)"
    )
    parser.add_argument("--unit", type=int, default=9, metavar="N", help="Modbus address (%(default)s)")
    parser.add_argument("--host", default="127.0.0.1", metavar="H", help="address on which to listen")
    parser.add_argument(
        "--port",
        type=int,
        default=PORT,
        metavar="P",
        help="port of RTU over TCP; 0 picks a free one (%(default)s)",
    )
    parser.add_argument(
        "--urcap-port", type=int, default=URCAP_PORT, metavar="P",
        help="port of the text protocol of the URCap; 0 picks a free one (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--link", type=Path, metavar="FILE", help="path to create as a symbolic link to the serial port"
    )
    parser.add_argument("--object", type=float, metavar="M", help="width of an object between the fingers, m")
    chosen = parser.parse_args(arguments)
    if not 1 <= chosen.unit <= 247:
        parser.error(f"--unit is {chosen.unit}, allowed: 1 to 247")
    stroke_m = MODELS[chosen.model].stroke_m
    if chosen.object is not None and not 0.0 <= chosen.object <= stroke_m:
        parser.error(f"--object is {chosen.object:g} m, allowed: 0 to {stroke_m:g} m for {chosen.model}")
    try:
        simulator = Simulator(
            chosen.model, chosen.unit, chosen.host, chosen.port, chosen.link, chosen.urcap_port
        )
    except (OSError, OverflowError) as exc:
        print(
            f"cobot: {chosen.host}, ports {chosen.port} and {chosen.urcap_port}: {exc}; choose another "
            "--port, --urcap-port or --link",
            file=sys.stderr,
        )
        return 1
    simulator.slave.fingers.object_m = chosen.object
    print(
        f"Simulated {chosen.model} at {simulator.device}, {chosen.host}:{simulator.port} (RTU over TCP) and "
        f"{chosen.host}:{simulator.urcap_port} (URCap); Ctrl-C ends it."
    )
    print(
        f"robot: {{gripper: {{type: robotiq, model: {chosen.model}, device: '{simulator.device}'}}}}",
        flush=True,
    )
    ended = threading.Event()
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, lambda *_: ended.set())
    ended.wait()
    simulator.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
