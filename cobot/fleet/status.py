"""The HTTP status of the hub's error responses."""

from __future__ import annotations

from cobot.errors import (
    AuthenticationError,
    BusyError,
    CobotError,
    ConflictError,
    InputError,
    NotFoundError,
    NotSupportedError,
    PayloadError,
    PermissionDenied,
)

STATUS = {
    NotFoundError: 404,
    InputError: 422,
    AuthenticationError: 401,
    PermissionDenied: 403,
    ConflictError: 409,
    BusyError: 409,
    PayloadError: 413,
    NotSupportedError: 501,
}


def status_of(error: CobotError) -> int:
    return next((status for kind, status in STATUS.items() if isinstance(error, kind)), 503)
