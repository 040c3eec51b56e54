"""Results of requests and checks in rtloop: accepted, rejected with a reason, or answered in a later
cycle.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Accepted:
    """The request has been carried out or has begun, or the check has passed."""


@dataclass(frozen=True, slots=True)
class Later:
    """The command takes several cycles. The part of rtloop that executes the command sends the result at the
    end.
    """


@dataclass(frozen=True, slots=True)
class Rejected:
    """The request is rejected, or the check has failed. A rejected command or session has changed nothing.

    Attributes:
        reason: the cause, as text for users.
    """

    reason: str


Result = Accepted | Later | Rejected
ACCEPTED, LATER = Accepted(), Later()


def first_rejection(results: Iterable[Accepted | Rejected]) -> Accepted | Rejected:
    """Return the first rejection, or `ACCEPTED` if all results are accepted. If `results` is a generator, the
    checks after the first rejection are not run.
    """
    return next((result for result in results if isinstance(result, Rejected)), ACCEPTED)


def result_of(reason: str) -> Accepted | Rejected:
    """Convert the text returned by a check to a result. The text is the reason for a rejection, or "" if the
    check has passed.
    """
    return Rejected(reason) if reason else ACCEPTED
