"""A client on another computer, simulated by a process that the load on this computer delays as little as
possible.

It is of a session of its own, for Linux may share the processor among sessions before it looks at niceness.
"""

from __future__ import annotations

import contextlib
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator

import httpx

from cobot.client import Client
from cobot.launch.process import Niceness, set_niceness

TOO_LATE_S = 1.0
"""An answer that takes longer, or does not come, counts as this."""
UNVERIFIED = ssl.create_default_context()
"""Made once: it takes longer than an answer."""
UNVERIFIED.check_hostname, UNVERIFIED.verify_mode = False, ssl.CERT_NONE


class Visitor:
    """Opens a new connection for each request, like a person who comes to stop the arm."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def stop(self, url: str) -> int:
        """Stop the arm. Returns the time on CLOCK_MONOTONIC at the start of the request, ns."""
        return round(self._ask("stop", url))

    def answer_ms(self, url: str) -> float:
        """The time until an answer to POST /stop, ms."""
        return self._ask("answer", url)

    def _ask(self, what: str, url: str) -> float:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{what} {url}\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())


@contextlib.contextmanager
def visitor() -> Iterator[Visitor]:
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.web.visitor"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield Visitor(process)
    finally:
        process.kill()
        process.communicate()


def main() -> None:
    set_niceness(Niceness.PROMPT, session=True)
    Client("http://localhost").close()  # what is loaded for the first one takes longer than a stop
    for line in sys.stdin:
        what, url = line.split()
        print(_stop(url) if what == "stop" else _answer_ms(url), flush=True)


def _stop(url: str) -> int:
    begun_ns = time.monotonic_ns()
    with Client(url) as stopper:
        stopper.stop()
    return begun_ns


def _answer_ms(url: str) -> float:
    begun_s = time.monotonic()
    try:
        httpx.post(f"{url}/stop", timeout=TOO_LATE_S, verify=UNVERIFIED).raise_for_status()
    except httpx.HTTPError:
        return 1e3 * TOO_LATE_S
    return 1e3 * min(time.monotonic() - begun_s, TOO_LATE_S)


if __name__ == "__main__":
    main()
