"""Control of a robot: reads its state, takes it, releases it, and takes it over from another client."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

from app.services.clients import CLIENT, RequestClient
from app.services.rights.lease import TIMEOUT_S
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from app.services.rights.stopping import StopService
from app.services.state.link import RobotLink
from cobot.errors import CobotError, ConflictError


@dataclass(frozen=True, slots=True)
class ControlStatus:
    """State of the control of a robot.

    Attributes:
        held: whether a client has control.
        holder, address: name and address of the client that has control. None if no client has control, or if
            a process that streams through shared memory has it. For such a process only `what` is known.
        how: "explicit" with a lease, "implicit" with a running motion.
        what: the request that is moving the arm.
        since: time when control was taken, if known.
        until: time when the lease ends, if nothing moves until then.
        speed_fraction: speed override, as a share of the planned speed.
    """

    held: bool
    holder: str | None
    address: str | None
    how: str | None
    what: str | None
    since: datetime | None
    until: datetime | None
    speed_fraction: float


@dataclass(frozen=True, slots=True)
class Taken:
    """The result of taking control.

    Attributes:
        token: token of the lease.
        former: the client that had control until now; None if control was free.
        stopped: description of the request that was stopped; None if there was none.
    """

    token: str
    former: str | None
    stopped: list[str]


class ControlService:
    """Manages control of one robot, for the client of the current task."""

    def __init__(self, link: RobotLink, ownership: Ownership, stopping: StopService) -> None:
        self._link = link
        self._ownership = ownership
        self._stopping = stopping

    def state(self) -> ControlStatus:
        """Return the current state of control."""
        ownership = self._ownership
        lease, moving, what = ownership.lease.current, ownership.moving, ownership.owner
        client: RequestClient | None = None
        since_s: float | None = None
        if lease is not None:
            client, since_s = lease.client, lease.since_s
        elif moving is not None:
            client, since_s = moving.client, moving.since_s
        return ControlStatus(
            held=lease is not None or what is not None,
            holder=None if client is None else client.name,
            address=None if client is None else client.address,
            how="explicit" if lease is not None else "implicit" if what is not None else None,
            what=what,
            since=self._moment(since_s),
            until=None if lease is None else self._moment(lease.until_s),
            speed_fraction=ownership.speed_fraction,
        )

    async def take(self, timeout_s: float = TIMEOUT_S, *, force: bool = False, stop_s: float = 8.0) -> Taken:
        """Take control, or renew the lease.

        Args:
            timeout_s: time without a motion after which the lease ends, s.
            force: take control over. The current motion ends, and the former holder is notified.
            stop_s: timeout for the arm to stop when control is taken over, s.

        Raises:
            ConflictError: another client has control, and `force` is not set. The error names the client.
        """
        ownership, client = self._ownership, CLIENT.get()
        lease = ownership.lease
        if lease.holds(client):
            return Taken(lease.take(client, timeout_s).token, None, [])
        if not force:
            self._require_free(client)
            return Taken(lease.take(client, timeout_s).token, None, [])
        former = self._former()
        # before the stop, so that no other client can take control meanwhile
        token = lease.take(client, timeout_s).token
        if not former and ownership.owner is None:
            return Taken(token, None, [])
        reason = StopReason(f"{client} has taken control", "taken_over")
        for each in former:
            if each.tell is not None:
                each.tell(reason.text)
        ownership.interrupt(reason.error)
        stopped = await self._stopping.stop(stop_s, reason)
        names = " and ".join(dict.fromkeys(map(str, former))) or "a local client"
        return Taken(token, names, stopped.stopped)

    def release(self) -> None:
        """Release control. Does nothing if it is free.

        Raises:
            ConflictError: another client has control, or this client has lost it; the error gives the reason.
        """
        self._ownership.lease.release(CLIENT.get())

    async def set_control(self, wanted: bool) -> tuple[bool, str]:
        """Take or release control. Returns whether this succeeded, and the reason if it did not."""
        try:
            if wanted:
                await self.take()
            else:
                self.release()
        except CobotError as exc:
            return False, str(exc)
        return True, ""

    def drop_client(self, client: RequestClient) -> None:
        """Release the lease of a WebSocket that has closed."""
        self._ownership.lease.drop_client(client)

    def end_if_revoked(self) -> None:
        """Release the lease if its client's access token has been deleted or has expired."""
        self._ownership.lease.end_if_revoked()

    def _require_free(self, client: RequestClient) -> None:
        lease, owner = self._ownership.lease, self._ownership.owner
        if owner is not None:
            raise ConflictError(f"the robot is in use by {owner}; wait, or take control with force: true")
        if lease.current is not None:
            lease.require(RequestClient(client.name, client.address))

    def _former(self) -> list[RequestClient]:
        """List the clients that have control by a lease or by a motion, each once."""
        lease, moving = self._ownership.lease.current, self._ownership.moving
        clients = [each.client for each in (lease, moving) if each is not None]
        return list({id(each): each for each in clients}.values())

    def _moment(self, time_s: float | None) -> datetime | None:
        """Convert a time of the service's clock to wall-clock time."""
        if time_s is None:
            return None
        clock = self._link.clock
        return datetime.fromtimestamp(clock.wall_ns() * 1e-9 + time_s - clock.now_s(), UTC)
