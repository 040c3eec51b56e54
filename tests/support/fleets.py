"""A hub, and processes of cells, for tests of fleets."""

from __future__ import annotations

import contextlib
import signal
import socket
import ssl
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
from cobot_run import Run, until
from tcp_proxy import TcpProxy

FLEET = "test-hall"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


class Hub:
    """`cobot fleet serve`, which may be killed and started again at the same addresses.

    Args:
        certificates: folder of the fleet; None: neither TLS nor tokens.
        token: of the person who asks.
        recordings: folder for the recordings of cells.
        host: address at which it listens.
    """

    def __init__(
        self,
        certificates: Path | None = None,
        token: str = "",
        recordings: Path | None = None,
        host: str = "127.0.0.1",
    ) -> None:
        self.certificates, self.recordings, self.host = certificates, recordings, host
        self.zenoh_port, self.port, self.panel_port = free_port(), free_port(), free_port()
        trusted = certificates and ssl.create_default_context(cafile=certificates / "ca.pem")
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self.http = httpx.Client(
            base_url=self.url,
            verify=trusted or True,
            timeout=30.0,
            headers={"X-Client-Name": "ada"} | headers,
        )
        self.start()

    @property
    def command(self) -> list[str]:
        options = ["--name", FLEET, "--listen", self.address, "--port", str(self.port)]
        options += ["--host", self.host, "--panel-port", str(self.panel_port)]
        if self.certificates is not None:
            options += ["--certificates", str(self.certificates)]
        if self.recordings is not None:
            options += ["--recordings", str(self.recordings)]
        return [sys.executable, "-P", "-m", "cobot", "fleet", "serve", *options]

    @property
    def url(self) -> str:
        return f"{'http' if self.certificates is None else 'https'}://{self.host}:{self.port}"

    @property
    def address(self) -> str:
        """For cells."""
        return f"{'tcp' if self.certificates is None else 'tls'}/{self.host}:{self.zenoh_port}"

    def start(self) -> None:
        self.process = subprocess.Popen(self.command, stdout=subprocess.DEVNULL)
        until(self.answers)

    def answers(self) -> bool:
        assert self.process.poll() is None
        with contextlib.suppress(httpx.TransportError):
            return self.http.get("/health").status_code == 200
        return False

    def end(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait(30.0)

    def close(self) -> None:
        assert self.end() == 0
        self.http.close()

    def robot(self, cell: str) -> dict[str, Any]:
        found = self.http.get("/cells").json()["robots"]
        return next((each for each in found if each["cell"] == cell), {"state": "unknown", "alive": False})

    def until_state(self, cell: str, *states: str) -> dict[str, Any]:
        until(lambda: self.robot(cell)["state"] in states, lambda: f": {self.robot(cell)}")
        return self.robot(cell)

    def stop(self, path: str, **body: Any) -> dict[str, Any]:
        answer = self.http.post(path, json=body)
        assert answer.status_code == 200, answer.text
        return answer.json()


class OtherCell:
    """The process of a cell alone, for the arm of another one, behind a proxy.

    Args:
        port: of the hub, or of a router on the way to it.
    """

    def __init__(self, port: int, run: Run, folder: Path, name: str, more: str = "") -> None:
        self.proxy = TcpProxy(port)
        self.folder = folder
        config = folder / f"{name}.yaml"
        connect = f"['tcp/127.0.0.1:{self.proxy.port}']"
        fleet = f"fleet: {{name: {FLEET}, cell: {name}, connect: {connect}{more}}}\n"
        config.write_text(run.config.read_text().split("fleet:")[0] + fleet, encoding="utf-8")
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "cobot.fleet.cell", "--config", str(config)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def close(self) -> None:
        self.process.send_signal(signal.SIGCONT)
        self.process.kill()
        self.process.communicate()
        self.proxy.close()
