"""Interface between a `Robot` and its rtloop. `cobot.client.shared_memory` and `cobot.client.websocket`
implement it.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cobot.clock import Clock
from cobot.errors import NotSupportedError


class Transport(Protocol):
    """A connection to a robot. Methods of one session may be called from several threads.

    Attributes:
        robot: robot name.
        url: URL of the robot's service; "" for a robot without a service.
        dof: number of joints.
        clock: the robot's clock.
    """

    robot: str
    url: str
    dof: int
    clock: Clock

    @property
    def info(self) -> np.ndarray:
        """The latest record of `cobot.ipc.layout.info_dtype`. The flange pose in this record changes with the
        tool.

        Raises:
            UnavailableError: the record cannot be read.
        """
        ...

    def state(self) -> np.ndarray:
        """The newest state, a record of `cobot.ipc.state_fields.state_dtype`. The caller may keep it.

        Raises:
            UnavailableError: there is no fresh state.
        """
        ...

    def open_session(self, request: np.ndarray) -> int:
        """Begin to stream.

        Args:
            request: record of `cobot.ipc.layout.session_dtype`; the transport fills in the number, the
                process and the count of stops.

        Returns:
            Session number.

        Raises:
            ConflictError: another client has a session.
            ExecutionError: rtloop rejects the session; the message gives the reason.
            UnavailableError: rtloop does not answer.
        """
        ...

    def send_setpoint(self, setpoint: np.ndarray) -> None:
        """Send the current setpoint, a record of `cobot.ipc.layout.setpoint_dtype`.

        Raises:
            InputError: raised once if the first target was too far from the arm to be followed.
        """
        ...

    def send_chunk(self, chunk: np.ndarray) -> None:
        """Send timed targets, a record of `cobot.ipc.layout.chunk_dtype`."""
        ...

    def request_estop(self) -> None:
        """Trigger an e-stop without waiting. Only the client that has the session may do this."""
        ...

    def end_session(self) -> None:
        """Stop streaming, which stops the arm. Without a session, nothing happens."""
        ...

    def close(self) -> None:
        """End the session and disconnect from the robot."""
        ...


def local_transport(robot: str, clock: Clock) -> Transport:
    """A transport to a robot on this computer, by name.

    Raises:
        NotSupportedError: only the distribution cobot-client is installed, which has no shared memory.
    """
    try:
        from cobot.client.shared_memory import SharedMemoryTransport
    except ImportError as exc:
        raise NotSupportedError(
            f"robot {robot!r}: a name is looked up in shared memory, which exists only on Linux and with "
            "the service installed; use the URL of the service, Robot('http://HOST:8007')"
        ) from exc
    return SharedMemoryTransport(robot, clock)
