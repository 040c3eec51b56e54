"""A fleet on this computer: a hub and three cells, each with a simulated arm.

    .venv/bin/python examples/fleet/start.py

It prints the address of the page, a token, and commands for another terminal. Ctrl-C ends it. Certificates,
settings and logs are in a temporary folder, which is deleted at the end.
"""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

CELLS = ("one", "two", "three")
NEXT = """\
.venv/bin/cobot fleet list
.venv/bin/cobot fleet roll-out examples/fleet/seams one two three --version 1 --wave 2
.venv/bin/cobot fleet run --all --program seam
.venv/bin/cobot fleet stop --all
env -u COBOT_TOKEN .venv/bin/cobot record dump --url http://localhost:{port}    # a recording in the cell one
.venv/bin/cobot fleet pull recordings                                     # some seconds later"""
RESTART_S = 30.0
"""Time after a kill within which a command is started again, s. The arm of a killed cell ends a moment after
the cell, which cannot start before that.
"""
COBOT = [sys.executable, "-P", "-m", "cobot"]
SETTINGS = """\
robot: {{name: arm-{cell}}}
logs: {folder}/{cell}
web: {{port: {web}}}
ros: {{enabled: false}}
planning: {{workers: 1}}
fleet:
  name: hall
  cell: {cell}
  zone: {zone}
  connect: [tls/localhost:{port}]
  certificates: {folder}/certificates/cells/{cell}
  accept: {{roll_out: operator}}
  recordings: true
"""


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def prepare(folder: Path) -> list[list[str]]:
    """Make certificates, a token and settings. Returns the commands to run."""
    certificates = folder / "certificates"
    port, page, panels, first = free_port(), free_port(), free_port(), free_port()
    for kind, names in (("hub", ("localhost", "127.0.0.1")), ("cell", CELLS)):
        command = [*COBOT, "fleet", "certificate", str(certificates), kind, *names]
        subprocess.run(command, check=True, capture_output=True)
    command = [
        *COBOT,
        "token",
        "create",
        "ada",
        "--role",
        "operator",
        "--file",
        f"{certificates}/tokens.json",
    ]
    token = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    commands = [
        [
            *(*COBOT, "fleet", "serve", "--name", "hall", "--certificates", str(certificates)),
            *("--listen", f"tls/127.0.0.1:{port}", "--port", str(page)),
            *("--panel-port", str(panels), "--recordings", f"{folder}/recordings"),
        ]
    ]
    for cell in CELLS:
        config = folder / f"{cell}.yaml"
        zone = "north" if cell == "one" else "south"
        web = first if cell == CELLS[0] else 0
        settings = SETTINGS.format(cell=cell, zone=zone, folder=folder, port=port, web=web)
        config.write_text(settings, encoding="utf-8")
        commands.append([*COBOT, "run", "--config", str(config)])
    print(f"the page:  https://localhost:{page} (your browser does not know the certificate: accept it)")
    print(f"the token: {token}")
    print(f"export COBOT_FLEET=https://localhost:{page} COBOT_TOKEN={token}", end=" ")
    print(f"COBOT_CERTIFICATE={certificates}/ca.pem")
    print(NEXT.format(port=first), flush=True)
    return commands


class Process:
    """A command that runs until the script ends, and is started again if it is killed."""

    def __init__(self, command: Sequence[str], output: BinaryIO) -> None:
        self.command, self._output = command, output
        self._killed_s = -RESTART_S
        self._start()

    def _start(self) -> None:
        self._process = subprocess.Popen(self.command, stdout=self._output, stderr=self._output)

    def failure(self) -> int | None:
        """The exit status if the command ended by itself; None while it is running, or is being started again
        after a kill.
        """
        code = self._process.poll()
        if code is None:
            return None
        print(f"ended with {code}: {' '.join(self.command)}", flush=True)
        if code < 0:
            self._killed_s = time.monotonic()
        elif time.monotonic() > self._killed_s + RESTART_S:
            return code
        self._start()
        return None

    def terminate(self) -> None:
        self._process.terminate()

    def wait(self) -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(20.0)


def watch(commands: Sequence[Sequence[str]], output: BinaryIO) -> int:
    """Run all commands until one of them fails. Returns its exit status."""
    processes = [Process(command, output) for command in commands]
    try:
        while True:
            time.sleep(1.0)
            for process in processes:
                code = process.failure()
                if code is not None:
                    return code or 1
    except KeyboardInterrupt:
        return 0
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def main() -> int:
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="cobot-fleet-") as folder:
        file = Path(folder) / "output.txt"
        with file.open("wb") as output:
            code = watch(prepare(Path(folder)), output)
        if code:
            print(file.read_text(encoding="utf-8", errors="replace")[-2000:])
        return code


if __name__ == "__main__":
    sys.exit(main())
