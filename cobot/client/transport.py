"""What a `Robot` asks of the way to its rtloop: `cobot.client.shared_memory`, or `cobot.client.websocket`."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cobot.clock import Clock
from cobot.errors import NotSupportedError


class Transport(Protocol):
    """The way to a robot. Methods of one session may be called from several threads.

    Attributes:
        robot: its name.
        url: of its service, "" if it has none.
        dof: number of joints.
        clock: that its robot goes by.
        info: record of `cobot.ipc.layout.info_dtype`.
    """

    robot: str
    url: str
    dof: int
    clock: Clock
    info: np.ndarray

    def state(self) -> np.ndarray:
        """The newest state, a record of `cobot.ipc.state_fields.state_dtype`, which is the caller's to keep.

        Raises:
            UnavailableError: there is none that is fresh.
        """
        ...

    def open_session(self, request: np.ndarray) -> int:
        """Begin to stream.

        Args:
            request: record of `cobot.ipc.layout.session_dtype`; number, process and count of stops are filled
                in.

        Returns:
            The session's number.

        Raises:
            ConflictError: somebody else streams.
            ExecutionError: rtloop refuses, with its reason.
            UnavailableError: it does not answer.
        """
        ...

    def send_setpoint(self, setpoint: np.ndarray) -> None:
        """Give what is wanted now, a record of `cobot.ipc.layout.setpoint_dtype`.

        Raises:
            InputError: once, the first target was too far from the arm to be followed.
        """
        ...

    def send_chunk(self, chunk: np.ndarray) -> None:
        """Give timed targets, a record of `cobot.ipc.layout.chunk_dtype`."""
        ...

    def request_estop(self) -> None:
        """Trigger an e-stop without waiting for anything. Only the client with the session may."""
        ...

    def end_session(self) -> None:
        """Stop streaming; the arm comes to rest. Nothing happens if there is no session."""
        ...

    def close(self) -> None:
        """End the session and let go of the robot."""
        ...


def local_transport(robot: str, clock: Clock) -> Transport:
    """To a robot that runs on this computer, by its name.

    Raises:
        NotSupportedError: this is the distribution cobot-client alone, which has no shared memory.
    """
    try:
        from cobot.client.shared_memory import SharedMemoryTransport
    except ImportError as exc:
        raise NotSupportedError(
            f"robot {robot!r}: a name is looked up in shared memory, which exists on Linux with the service "
            "installed only; use the URL of the service, Robot('http://HOST:8007')"
        ) from exc
    return SharedMemoryTransport(robot, clock)
