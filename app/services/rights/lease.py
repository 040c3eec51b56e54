"""The control lease: the exclusive right to move a robot, between motions too.

A motion, a session or a sequence has the robot while it lasts: see `Ownership`. To keep others from moving
the robot before, between or after them, a client takes a lease. The lease ends when it is released, when its
client disconnects, when it expires unused, or when another client takes it over. A stop never needs it.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass

from app.services.clients import RequestClient
from cobot.clock import Clock
from cobot.errors import ConflictError

TIMEOUTS_S = (1.0, 3600.0)
"""The shortest and the longest time that a lease may go unused, s."""
TIMEOUT_S = 60.0
KEPT_ENDS = 100
"""Number of ended leases that are remembered, so that clients that still use them get the reason."""


@dataclass(slots=True)
class Lease:
    """One client's control, from when it was taken.

    Attributes:
        token: a client that sends it is the holder; so is the WebSocket that has taken the lease.
        since_s, until_s: on the service's clock; `until_s` moves on while it is used.
        timeout_s: how long it lasts unused.
    """

    client: RequestClient
    token: str
    since_s: float
    until_s: float
    timeout_s: float


class ControlLease:
    """The lease of one robot. An expired lease ends when it is next read.

    Args:
        moving: whether a motion or a sequence is under way, during which none expires.
        ended: called when a lease has ended.
        tell: called with what has happened to a lease: "taken", "released", "expired", "taken over" or
            "disconnected", and with the lease.
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
        self._ends: dict[str, str] = {}  # why each token holds no longer

    @property
    def current(self) -> Lease | None:
        """The lease that is held, or None."""
        lease = self._lease
        if lease is not None and not self._moving() and self._clock.now_s() >= lease.until_s:
            how = f"has expired: nothing has moved for {lease.timeout_s:g} s; take control again"
            self._end("expired", how)
        return self._lease

    def holds(self, client: RequestClient) -> bool:
        """Whether the lease is this client's."""
        lease = self.current
        return lease is not None and (lease.client is client or lease.token in client.leases)

    def require_not_lost(self, client: RequestClient) -> None:
        """See that a client does not go on as if it still had what it has lost.

        Raises:
            ConflictError: its lease has ended, with how.
        """
        if self.holds(client):
            return
        for token in client.leases:
            if token in self._ends:
                raise ConflictError(self._ends[token])

    def require(self, client: RequestClient) -> None:
        """Check that no other client has the lease.

        Raises:
            ConflictError: another client has it (named in the error); or this client's own has ended, with
                the reason.
        """
        self.require_not_lost(client)
        lease = self.current
        if lease is not None and not self.holds(client):
            left_s = lease.until_s - self._clock.now_s()
            raise ConflictError(
                f"the robot is under the control of {lease.client}, for {left_s:.0f} s unless they move: "
                "wait, or take over: POST /robot/control with force"
            )

    def take(self, client: RequestClient, timeout_s: float) -> Lease:
        """Give the lease to a client, even if another has it. The client's own lease is renewed."""
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
        """Its holder moves."""
        if self._lease is not None:
            self._lease.until_s = self._clock.now_s() + self._lease.timeout_s

    def release(self, client: RequestClient) -> None:
        """Let go; without a lease nothing happens.

        Raises:
            ConflictError: see `require`.
        """
        self.require(client)
        if self.current is not None:
            self._end("released", "was released")

    def drop_client(self, client: RequestClient) -> None:
        """A WebSocket is gone, and with it what it has taken."""
        if self._lease is not None and self._lease.client is client:
            self._end("disconnected", "ended when its client disconnected")

    def _end(self, what: str, how: str) -> None:
        assert self._lease is not None
        self._tell(what, self._lease)
        self._ends[self._lease.token] = f"the control that {self._lease.client} had {how}"
        if len(self._ends) > KEPT_ENDS:
            del self._ends[next(iter(self._ends))]
        self._lease = None
        self._ended()
