"""The engines that compute a study: processes on this computer, or a Dask cluster."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from cobot.errors import InputError, NotSupportedError, UnavailableError
from cobot.strict import shown

LOCAL, DASK = "local", "dask"
CONNECT_S = 10.0
"""Timeout for connecting to a scheduler, in seconds."""


@dataclass(frozen=True, slots=True)
class StudyEngine:
    """An executor and the number of its workers. If the executor is None, the run creates its own pool."""

    executor: Executor | None
    workers: int


@contextmanager
def engine(name: str, workers: int | None, niceness: int) -> Iterator[StudyEngine]:
    """Context manager that provides the engine with this name: local or dask://HOST:PORT.

    Args:
        workers: number of processes on this computer; None means one per core. Dask determines its own
            number.

    Raises:
        InputError: the name is invalid, or the options cannot be used with this engine.
        NotSupportedError: Dask is not installed.
        UnavailableError: the scheduler does not answer or has no workers.
    """
    if name == LOCAL:
        yield StudyEngine(None, workers or len(os.sched_getaffinity(0)))
        return
    host, port = _address(name)
    if workers is not None or niceness:
        raise InputError(
            f"--workers and --nice are for --engine local; the workers of {name} are started with Dask"
        )
    if find_spec("distributed") is None:
        raise NotSupportedError(f"--engine {name} needs Dask; install cobot[study]")
    with _cluster(host, port) as found:
        yield found


def _address(name: str) -> tuple[str, int]:
    """Host and port of dask://HOST:PORT."""
    try:
        parts = urlsplit(name)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not name.startswith(f"{DASK}://") or not host or not port:
        raise InputError(f"--engine {shown(name)}: must be {LOCAL} or {DASK}://HOST:PORT")
    return host, port


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


@contextmanager
def _cluster(host: str, port: int) -> Iterator[StudyEngine]:
    from distributed import Client, Security

    security = Security()  # from Dask's configuration and environment
    encrypted = bool(security.require_encryption and security.tls_ca_file and security.tls_client_cert)
    if not encrypted and not _is_loopback(host):
        raise InputError(
            f"--engine {DASK}://{host}:{port}: a Dask worker executes any code that reaches it, so a host "
            "other than 127.0.0.1 needs mutual TLS; give Dask its certificates "
            "and require encryption (docs/studies.md)"
        )
    address = f"{'tls' if encrypted else 'tcp'}://{f'[{host}]' if ':' in host else host}:{port}"
    try:
        client: Any = Client(address, timeout=CONNECT_S, set_as_default=False, security=security)
    except (OSError, TimeoutError) as exc:
        raise UnavailableError(
            f"the Dask scheduler at {address} does not answer within {CONNECT_S:g} s; start `dask scheduler`"
        ) from exc
    with contextlib.closing(client):
        workers = sum(client.nthreads().values())
        if not workers:
            raise UnavailableError(
                f"the Dask scheduler at {address} has no workers; start `dask worker {address}`"
            )
        yield StudyEngine(client.get_executor(pure=False), workers)
