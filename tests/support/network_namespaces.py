"""Computers of a test's own: network namespaces of Linux, and cables between them."""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from cobot_run import until

_libc = ctypes.CDLL(None, use_errno=True)
_CLONE_NEWNET = 0x40000000


class Host:
    """A computer with a loopback interface of its own; it is gone with the process that holds it.

    What is started or opened within the block `inside()` has its network, and keeps it.
    """

    def __init__(self) -> None:
        self._holder = subprocess.Popen(
            ["unshare", "--net", "sh", "-c", "echo there; exec cat"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.pid = self._holder.pid
        assert self._holder.stdout is not None
        assert self._holder.stderr is not None
        if self._holder.stdout.readline() != "there\n":
            why = self._holder.communicate()[1].strip()
            pytest.skip(f"needs network namespaces: {why}")
        self.ip("link", "set", "lo", "up")

    def ip(self, *words: str) -> str:
        """What the command `ip` prints on that computer."""
        with self.inside():
            return subprocess.run(["ip", *words], check=True, capture_output=True, text=True).stdout

    @contextmanager
    def inside(self) -> Iterator[None]:
        """The calling thread is on that computer."""
        with (
            open("/proc/thread-self/ns/net", "rb") as here,
            open(f"/proc/{self.pid}/ns/net", "rb") as there,
        ):
            _enter(there.fileno())
            try:
                yield
            finally:
                _enter(here.fileno())

    def end(self) -> None:
        self._holder.communicate()


@contextmanager
def hosts(number: int) -> Iterator[list[Host]]:
    """So many, not connected. Without the rights or the tools for them: skips the test."""
    if subprocess.run(["ip", "-V"], capture_output=True, check=False).returncode != 0:
        pytest.skip("needs the command ip: apt-get install iproute2")
    with ExitStack() as ends:
        made = []
        for _ in range(number):
            made.append(Host())
            ends.callback(made[-1].end)
        yield made


def connect(one: Host, other: Host, network: int) -> None:
    """A cable between two, called netN on both; their addresses on it are 10.9.N.1 and 10.9.N.2."""
    name = f"net{network}"
    far_end = ("type", "veth", "peer", "name", name, "netns", str(other.pid))
    one.ip("link", "add", name, *far_end)
    for number, host in enumerate((one, other), 1):
        host.ip("address", "add", f"10.9.{network}.{number}/24", "dev", name)
        host.ip("link", "set", name, "up")
    for host in (one, other):  # Fast DDS does not look for networks again
        until(lambda host=host: "state UP" in host.ip("link", "show", name))


def route(one: Host, router: Host, other: Host) -> None:
    """The second lets through what the others send each other, which is no multicast."""
    connect(one, router, 0)
    connect(router, other, 1)
    one.ip("route", "add", "10.9.1.0/24", "via", "10.9.0.2")
    other.ip("route", "add", "10.9.0.0/24", "via", "10.9.1.1")
    with router.inside():
        Path("/proc/sys/net/ipv4/ip_forward").write_text("1", encoding="ascii")


def _enter(namespace: int) -> None:
    if _libc.setns(namespace, _CLONE_NEWNET) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
