"""The hub's part of cell panels: the people who have opened a panel, and signed requests to the cells."""

from __future__ import annotations

import asyncio
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import sha256
from typing import TYPE_CHECKING, NamedTuple

from cobot.access.roles import RoleName
from cobot.errors import (
    BY_CODE,
    AuthenticationError,
    BusyError,
    CobotError,
    InputError,
    NotFoundError,
    UnavailableError,
)
from cobot.fleet.certificates import Signer
from cobot.fleet.messages import read, written
from cobot.fleet.names import FleetKeys
from cobot.fleet.panel_messages import (
    MAX_PIECE_BYTES,
    MAX_PIECES,
    OPEN_S,
    PanelHead,
    PanelRequest,
    PanelWish,
)

if TYPE_CHECKING:
    import zenoh

MAX_PANELS = 200
"""Maximum number of panels that are open at the same time. If one more is opened, the least recently used
panel is closed.
"""
UNUSED_S = 900.0
"""Time without a request after which a panel is closed."""
MAX_OPEN_S = 12 * 3600.0
"""Time after which a panel is closed. It must then be opened again from the fleet page."""
NOT_OPEN = "this panel is no longer open; open it again from the page of the fleet"
ANSWER_S = 10.0
"""Timeout for an answer from a cell. A cell answers after 1 s even if it has no content."""


class PanelPerson(NamedTuple):
    """The name and the role of the token that opened a panel."""

    name: str
    role: RoleName


@dataclass(slots=True)
class OpenPanel:
    """A panel that a person has opened. Its address contains a secret, so the panel needs no token. The
    scripts of a cell therefore never see the person's token.

    Attributes:
        find: function that returns the person, or None if the token is no longer valid.
        used_s: time of the last request, including requests for a piece of a WebSocket.
        closed: whether the panel was closed to make room for another one.
        requests, sockets: numbers of requests and of WebSockets in progress.
        turns: limits the number of answer pieces that are in transit.
    """

    cell: str
    find: Callable[[], PanelPerson | None]
    opened_s: float = field(default_factory=time.monotonic)
    used_s: float = field(default_factory=time.monotonic)
    closed: bool = False
    requests: int = 0
    sockets: int = 0
    turns: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(MAX_PIECES))

    @property
    def is_over(self) -> bool:
        """Whether the panel was closed, was open for too long, or was not used for too long."""
        now_s = time.monotonic()
        return self.closed or now_s - self.opened_s >= MAX_OPEN_S or now_s - self.used_s >= UNUSED_S

    def use(self) -> PanelPerson:
        """Record that the panel has sent a request, and return the person who uses the panel.

        Raises:
            NotFoundError: the panel is no longer open.
            AuthenticationError: the token that opened the panel is no longer valid.
        """
        if self.is_over:
            raise NotFoundError(NOT_OPEN)
        self.used_s = time.monotonic()
        found = self.find()
        if found is None:
            raise AuthenticationError("your token is no longer valid; log in again on the page of the fleet")
        return found


class PanelLink:
    """The open panels, and the connection to their cells.

    Args:
        epoch: the epoch of the hub's time.
    """

    def __init__(
        self, fleet: str, epoch: str, keys: FleetKeys, session: zenoh.Session, signer: Signer
    ) -> None:
        self._fleet, self._epoch, self._keys = fleet, epoch, keys
        self._session, self._signer = session, signer
        self._open: dict[str, OpenPanel] = {}
        self._lock = threading.Lock()

    def open(self, cell: str, find: Callable[[], PanelPerson | None]) -> str:
        """Open the panel of a cell. Returns the secret part of its address."""
        with self._lock:
            self._forget()
            while len(self._open) >= MAX_PANELS:
                self._open.pop(min(self._open, key=lambda each: self._open[each].used_s)).closed = True
            name = secrets.token_urlsafe(24)
            self._open[name] = OpenPanel(cell, find)
            return name

    def get(self, name: str) -> OpenPanel:
        """Find an open panel.

        Raises:
            NotFoundError: no panel is open under this name.
        """
        with self._lock:
            self._forget()
            found = self._open.get(name)
            if found is None:
                raise NotFoundError(NOT_OPEN)
            return found

    def _forget(self) -> None:
        self._open = {name: each for name, each in self._open.items() if not each.is_over}

    async def ask(self, panel: OpenPanel, wish: PanelWish, body: bytes = b"") -> tuple[PanelHead, bytes]:
        """Send a request to a cell. Returns a piece of the answer.

        Raises:
            NotFoundError, AuthenticationError: see `OpenPanel.use`.
            UnavailableError: the cell does not answer.
            CobotError: the error that the cell reports.
        """
        import zenoh

        person = panel.use()
        now_s = time.monotonic()
        request = PanelRequest(
            id=secrets.token_hex(12),
            fleet=self._fleet,
            cell=panel.cell,
            who=person.name,
            role=person.role,
            epoch=self._epoch,
            issued_s=now_s,
            expires_s=now_s + OPEN_S,
            wish=wish,
            body=sha256(body).hexdigest(),
        )
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[zenoh.Sample | None] = loop.create_future()

        def take(sample: zenoh.Sample | None) -> None:
            if not answer.done():
                answer.set_result(sample)

        def hear(reply: zenoh.Reply) -> None:
            loop.call_soon_threadsafe(take, reply.ok)

        try:
            self._session.get(
                self._keys.panel(panel.cell),
                zenoh.handlers.Callback(hear, lambda: loop.call_soon_threadsafe(take, None)),
                payload=written(self._signer.signed(request)),
                attachment=body,
                timeout=ANSWER_S,
                # The priority is below that of states and commands. On congestion the request is dropped, so
                # that nothing waits for it.
                priority=zenoh.Priority.DATA_LOW,
                congestion_control=zenoh.CongestionControl.DROP,
            )
        except zenoh.ZError as exc:
            raise UnavailableError(f"the cell {panel.cell} cannot be reached: {exc}") from exc
        sample = await answer
        if sample is None or sample.attachment is None:
            raise UnavailableError(f"the cell {panel.cell} does not answer")
        head, content = read(PanelHead, bytes(sample.attachment)), bytes(sample.payload)
        if head.code != "ok":
            raise BY_CODE.get(head.code, CobotError)(head.text)
        if len(content) > MAX_PIECE_BYTES + 65536:
            raise InputError(
                f"the cell {panel.cell} has sent a piece of {len(content)} bytes, allowed: "
                f"{MAX_PIECE_BYTES + 65536}"
            )
        return head, content


def require_room(now: int, most: int, what: str) -> None:
    """Check that one more request may begin.

    Raises:
        BusyError: the maximum number of requests is in progress.
    """
    if now >= most:
        raise BusyError(f"{now} {what} are in progress, allowed: {most}; try again in a moment")
