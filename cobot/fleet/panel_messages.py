"""The messages that a hub uses to forward a browser's requests to the panel of a cell, and the answers.

A request is a query with a signed `PanelRequest`; the body is an attachment. The answer is a piece of the
content, with a `PanelHead` attached. Long answers and WebSockets are streams, which the hub reads
piece by piece. So a slow connection slows down the sender, and little data is in transit at any time.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal
from urllib.parse import unquote_to_bytes

from pydantic import AfterValidator, Field

from cobot.access.roles import RoleName
from cobot.addresses import NAME
from cobot.fleet.messages import Hash, Id, Name, Person, Seconds, Text
from cobot.strict import StrictModel

MAX_BODY_BYTES = 256 * 1024
"""Maximum size of a body that is sent to a cell, in bytes."""
MAX_ANSWER_BYTES = 64 * 2**20
"""Maximum size of an answer from a cell, in bytes."""
MAX_FRAME_BYTES = 64 * 1024
"""Maximum size of a WebSocket message to a cell, in bytes."""
PIECE_BYTES = 16 * 1024
"""Size of a piece of an answer, in bytes. A piece may only be larger if it contains a single message."""
MAX_PIECES = 4
"""Maximum number of pieces that are in transit to a panel. On a slow line, the answer to a stop must wait for
the pieces that were sent before it, regardless of its priority.
"""
MAX_PIECE_BYTES = 512 * 1024
"""Maximum size of a piece, in bytes, because a single WebSocket message may be larger than `PIECE_BYTES`."""
MAX_REQUESTS, MAX_SOCKETS = 16, 8
"""For each open panel, the maximum number of HTTP requests in progress and of open WebSockets."""
WAIT_S = 1.0
"""How long a cell waits for content before it answers without content."""
IDLE_S = 5.0
"""Time after which a cell closes a stream that the hub does not read."""
OPEN_S = 10.0
"""Time in which a cell must receive a request."""
REQUEST_HEADERS = (
    "accept",
    "accept-language",
    "content-type",
    "idempotency-key",
    "if-match",
    "if-modified-since",
    "if-none-match",
    "prefer",
    "range",
    "x-control-token",
    "x-motion-token",
    "x-request-id",
)
ANSWER_HEADERS = (
    "accept-ranges",
    "cache-control",
    "content-disposition",
    "content-length",
    "content-range",
    "content-security-policy",
    "content-type",
    "etag",
    "last-modified",
    "location",
    "preference-applied",
    "retry-after",
    "x-request-id",
)
_PATH = re.compile(r"/[A-Za-z0-9._~!$&'()*+,;=:@%/-]{0,2000}")
_SOCKET = re.compile(rf"(/v1)?(/robots?(/{NAME})?)?/(stream|events)")


def _a_path(path: str) -> str:
    """Reject paths that two programs could interpret differently."""
    plain = unquote_to_bytes(path)
    odd = re.search(r"%(?![0-9A-Fa-f]{2})|%2[fF]|%5[cC]|//", path) or re.search(rb"[\x00-\x1f\x7f\\]", plain)
    if odd or not _PATH.fullmatch(path) or {b".", b".."} & set(plain.split(b"/")):
        raise ValueError("is not a valid path of a panel")
    return path


def _a_socket(path: str) -> str:
    if not _SOCKET.fullmatch(path):
        raise ValueError("only the WebSockets /stream and /events of robots are available through a hub")
    return path


PanelPath = Annotated[str, AfterValidator(_a_path)]
SocketPath = Annotated[str, AfterValidator(_a_socket)]
Query = Annotated[str, Field(pattern=r"^[!$-~]{0,2000}$")]
Header = Annotated[str, Field(pattern=r"^[\x20-\x7e]{0,1000}$")]
HeaderName = Annotated[str, Field(pattern=r"^[a-z-]{1,40}$")]
Headers = Annotated[dict[HeaderName, Header], Field(max_length=20)]


class OpenHttp(StrictModel):
    """Send a request to the cell's service."""

    kind: Literal["http"]
    method: Literal["GET", "HEAD", "POST", "PUT", "DELETE"]
    path: PanelPath
    query: Query = ""
    headers: Headers


class OpenSocket(StrictModel):
    """Open a WebSocket to the cell's service."""

    kind: Literal["socket"]
    path: SocketPath
    query: Query = ""


class ReadStream(StrictModel):
    """Read the next piece of an answer or WebSocket."""

    kind: Literal["read"]
    stream: Id


class SendMessage(StrictModel):
    """Send the body as a WebSocket message."""

    kind: Literal["send"]
    stream: Id
    is_text: bool


class CloseStream(StrictModel):
    """Close a stream that is no longer needed."""

    kind: Literal["close"]
    stream: Id


PanelWish = Annotated[
    OpenHttp | OpenSocket | ReadStream | SendMessage | CloseStream, Field(discriminator="kind")
]


class PanelRequest(StrictModel):
    """A request to the panel of a cell. Each one is executed once.

    Attributes:
        who, role: the person at the hub.
        epoch, issued_s, expires_s: see `cobot.fleet.messages.FleetCommand`.
        body: SHA-256 of the body, which is the attachment of the query.
    """

    id: Id
    fleet: Name
    cell: Name
    who: Person
    role: RoleName
    epoch: Id
    issued_s: Seconds
    expires_s: Seconds
    wish: PanelWish
    body: Hash


class PanelHead(StrictModel):
    """The header for one piece of an answer.

    Attributes:
        code: "ok", or the code of the error that `text` explains.
        stream: name of the stream with further pieces; "" if there are none.
        status, headers: those of the HTTP answer; the status is 0 in a piece without them.
        frames: for a WebSocket: whether each message is text, and its number of bytes.
        ended: whether this is the last piece.
    """

    code: Text = "ok"
    text: Text = ""
    stream: Id | Literal[""] = ""
    status: Annotated[int, Field(ge=0, le=599)] = 0
    headers: Headers = Field(default_factory=dict)
    frames: list[Annotated[tuple[bool, int], Field(strict=False)]] = Field(default_factory=list)
    ended: bool = False
