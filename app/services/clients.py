"""The client for which a task runs."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass

from cobot.access.roles import SERVICE


@dataclass(eq=False)
class RequestClient:
    """The client of a request or of an open WebSocket. Each request and each WebSocket has a separate object.

    Attributes:
        name: name of the access token. Without a token, the name that the client gives itself, in quotes, or
            "anonymous".
        address: address of the client, without the port.
        leases: the lease tokens that the client sends.
        sequence: the token of the sequence that sent the request; None if another client sent it.
        tell: function that is called with a message when another client takes over control; None if the
            client cannot be notified.
        is_valid: function that returns whether the access token is still valid; None for a client without a
            token.
    """

    name: str
    address: str = ""
    leases: frozenset[str] = frozenset()
    sequence: str | None = None
    tell: Callable[[str], None] | None = None
    is_valid: Callable[[], bool] | None = None

    def same(self, other: RequestClient) -> bool:
        """Whether both clients have the same name and address, and so probably belong to the same person."""
        return (self.name, self.address) == (other.name, other.address)

    def __str__(self) -> str:
        return f"{self.name} from {self.address}" if self.address else self.name


SERVICE_CLIENT = RequestClient(SERVICE.name)
CLIENT: ContextVar[RequestClient] = ContextVar("client", default=SERVICE_CLIENT)
"""The client for which the current task runs. Tasks started by the current task inherit it."""
