"""The control lease: the exclusive right to move a robot, including the time between motions.

During a motion, a session or a sequence no other client can move the robot; see `Ownership`. A client takes a
lease so that other clients cannot move the robot before, between or after its motions. The lease ends when it
is released, when its client disconnects, when it expires unused, or when another client takes it over. A stop
never needs a lease.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass

from app.services.clients import RequestClient
from cobot.clock import Clock
from cobot.errors import ConflictError

TIMEOUTS_S = (1.0, 3600.0)
"""Minimum and maximum timeout of an unused lease, s."""
TIMEOUT_S = 60.0
KEPT_ENDS = 100
"""Number of ended leases that are remembered, so that clients that still use them get the reason."""


@dataclass(slots=True)
class Lease:
    """A lease of one client.

    Attributes:
        token: text by which the holder identifies itself. A WebSocket that has taken the lease need not send
            it.
        since_s, until_s: beginning and end, on the service's clock. `until_s` is moved forward while the
            lease is used.
        timeout_s: time after which an unused lease ends, s.
    """

    client: RequestClient
    token: str
    since_s: float
    until_s: float
    timeout_s: float


class ControlLease:
    """The lease of one robot. A lease that has expired, or whose access token is invalid, ends when it is
    next read.

    Args:
        moving: function that returns whether a motion or a sequence is running. As long as it is, the lease
            does not expire.
        ended: function that is called when a lease has ended.
        tell: function that is called with the change of a lease ("taken", "released", "expired", "taken
            over", "disconnected" or "revoked") and with the lease.
    """

    def __init__(
        self,
        clock: Clock,
        moving: Callable[[], bool],
        ended: Callable[[], None],
        tell: Callable[[str, Lease], None] = lambda what, lease: None,
    ) -> None:
        self._clock = clock
        self._moving = moving
        self._ended = ended
        self._tell = tell
        self._lease: Lease | None = None
        self._ends: dict[str, str] = {}  # reason why each token is no longer valid

    @property
    def current(self) -> Lease | None:
        """The current lease, or None."""
        self.end_if_revoked()
        lease = self._lease
        if lease is not None and not self._moving() and self._clock.now_s() >= lease.until_s:
            how = f"has expired: nothing has moved for {lease.timeout_s:g} s; take control again"
            self._end("expired", how)
        return self._lease

    def holds(self, client: RequestClient) -> bool:
        """Whether this client has the lease."""
        lease = self.current
        return lease is not None and (lease.client is client or lease.token in client.leases)

    def require_not_lost(self, client: RequestClient) -> None:
        """Check that a client is not using a lease that it has lost.

        Raises:
            ConflictError: the client's lease has ended; the error gives the reason.
        """
        if self.holds(client):
            return
        for token in client.leases:
            if token in self._ends:
                raise ConflictError(self._ends[token], details={"cause": "control_lost"})

    def require(self, client: RequestClient) -> None:
        """Check that no other client has the lease.

        Raises:
            ConflictError: another client has the lease, and the error names this client; or this client's own
                lease has ended, and the error gives the reason.
        """
        self.require_not_lost(client)
        lease = self.current
        if lease is not None and not self.holds(client):
            left_s = lease.until_s - self._clock.now_s()
            raise ConflictError(
                f"{lease.client} has control of the robot, for another {left_s:.0f} s if nothing moves; "
                "wait, or take control with POST /robot/control and force: true",
                details={"cause": "control", "by": str(lease.client)},
            )

    def take(self, client: RequestClient, timeout_s: float) -> Lease:
        """Give the lease to a client, even if another client has it. If the client already has the lease, it
        is renewed.
        """
        now_s = self._clock.now_s()
        if self._lease is not None and self.holds(client):
            self._lease.timeout_s, self._lease.until_s = timeout_s, now_s + timeout_s
            return self._lease
        if self._lease is not None:
            self._end("taken over", f"was taken over by {client}")
        self._lease = Lease(client, secrets.token_hex(16), now_s, now_s + timeout_s, timeout_s)
        self._tell("taken", self._lease)
        return self._lease

    def renew(self) -> None:
        """Extend the lease, because its holder is moving the arm."""
        if self._lease is not None:
            self._lease.until_s = self._clock.now_s() + self._lease.timeout_s

    def release(self, client: RequestClient) -> None:
        """Release the lease. Does nothing if there is no lease.

        Raises:
            ConflictError: see `require`.
        """
        self.require(client)
        if self.current is not None:
            self._end("released", "was released")

    def end_if_revoked(self) -> None:
        """End the lease if the access token of its client has been deleted or has expired."""
        is_valid = None if self._lease is None else self._lease.client.is_valid
        if is_valid is not None and not is_valid():
            self._end("revoked", "ended because its access token was deleted or has expired")

    def drop_client(self, client: RequestClient) -> None:
        """End the lease of a WebSocket that has closed."""
        if self._lease is not None and self._lease.client is client:
            self._end("disconnected", "ended when its client disconnected")

    def _end(self, what: str, how: str) -> None:
        assert self._lease is not None
        self._tell(what, self._lease)
        self._ends[self._lease.token] = f"the control of {self._lease.client} {how}"
        if len(self._ends) > KEPT_ENDS:
            del self._ends[next(iter(self._ends))]
        self._lease = None
        self._ended()
