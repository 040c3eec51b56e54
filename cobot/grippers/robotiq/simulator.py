"""`cobot simulate robotiq`: a simulated gripper on a pseudo terminal and over TCP, for any client of its."""

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

PORT = 54321
MAX_CLIENTS = 8


class Simulator:
    """The gripper and its connections, served by a thread until it is closed.

    Attributes:
        slave: the gripper.
        device: path of the pseudo terminal.
        port: of TCP.
        late_s: how long each answer takes more, for tests.
    """

    def __init__(
        self,
        model: str = "2f85",
        unit: int = 9,
        host: str = "127.0.0.1",
        port: int = 0,
        link: Path | None = None,
    ) -> None:
        self.slave = Slave(Fingers(model, time.monotonic), unit)
        self.late_s = 0.0
        self._terminal, self._other = os.openpty()
        tty.setraw(self._other)  # it stays open: a client that goes away does not end the terminal
        self.device = os.ttyname(self._other)
        self._link = link
        if link is not None:
            if link.is_symlink():
                link.unlink()
            link.symlink_to(self.device)
            self.device = str(link)
        self._listener = socket.create_server((host, port))
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[socket.socket] = []
        self._wake, self._woken = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="robotiq", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it; its clients are disconnected."""
        os.write(self._woken, b"x")
        self._thread.join()
        for each in (*self._clients, self._listener):
            each.close()
        for number in (self._terminal, self._other, self._wake, self._woken):
            os.close(number)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def _serve(self) -> None:
        while True:
            waiting: list[Any] = [self._wake, self._terminal, self._listener, *self._clients]
            ready, _, _ = select.select(waiting, [], [])
            if self._wake in ready:
                return
            if self._terminal in ready:
                os.write(self._terminal, self._answer(os.read(self._terminal, 256)))
            if self._listener in ready:
                self._accept()
            for client in [each for each in self._clients if each in ready]:
                self._serve_client(client)

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients.append(client)
        if len(self._clients) > MAX_CLIENTS:
            self._clients.pop(0).close()

    def _serve_client(self, client: socket.socket) -> None:
        data = b""
        with contextlib.suppress(OSError):
            data = client.recv(256)
            if data:
                client.sendall(self._answer(data))
                return
        client.close()
        self._clients.remove(client)

    def _answer(self, data: bytes) -> bytes:
        answer = self.slave.feed(data)
        if self.late_s:
            time.sleep(self.late_s)
        return answer


@contextlib.contextmanager
def simulated(model: str = "2f85", **how: object) -> Iterator[Simulator]:
    """A simulated gripper for as long as the context lasts."""
    made = Simulator(model, **how)  # type: ignore[arg-type]
    try:
        yield made
    finally:
        made.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it until Ctrl-C."""
    parser = argparse.ArgumentParser(
        "cobot simulate robotiq", description="A simulated Robotiq gripper: docs/grippers.md."
    )
    parser.add_argument("--model", choices=list(MODELS), default="2f85", help="%(default)s without it")
    parser.add_argument(
        "--unit", type=int, default=9, metavar="N", help="Modbus address; %(default)s without it"
    )
    parser.add_argument("--host", default="127.0.0.1", metavar="H", help="address of RTU over TCP")
    parser.add_argument(
        "--port", type=int, default=PORT, metavar="P", help="0 picks a free one; %(default)s without it"
    )
    parser.add_argument("--link", type=Path, metavar="FILE", help="path that leads to the serial port")
    parser.add_argument("--object", type=float, metavar="M", help="width of what is between the fingers, m")
    chosen = parser.parse_args(arguments)
    try:
        simulator = Simulator(chosen.model, chosen.unit, chosen.host, chosen.port, chosen.link)
    except (OSError, OverflowError) as exc:
        print(f"cobot: {chosen.host}:{chosen.port}: {exc}; choose another --port or --link", file=sys.stderr)
        return 1
    simulator.slave.fingers.object_m = chosen.object
    print(
        f"Simulated {chosen.model} at {simulator.device} and {chosen.host}:{simulator.port}; Ctrl-C ends it."
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
