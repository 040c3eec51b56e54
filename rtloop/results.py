"""Results of what rtloop is asked to do: accepted, rejected for a reason, or answered in a later cycle."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Accepted:
    """The request is carried out, or has begun."""


@dataclass(frozen=True, slots=True)
class Later:
    """The work takes several cycles. The part that does it sends the result at its end."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """The request is rejected. A rejected command or session has changed nothing.

    Attributes:
        reason: text for the client.
    """

    reason: str


Result = Accepted | Later | Rejected
ACCEPTED, LATER = Accepted(), Later()
