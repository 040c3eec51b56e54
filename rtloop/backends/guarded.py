"""A wrapper that converts all errors of a backend to a `BackendError` with printable text. A third-party
class or its SDK may raise any exception.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, cast

from cobot.foreign import plain_error, plain_text
from rtloop.backends import protocols
from rtloop.backends.protocols import Backend, BackendError

NAMES = frozenset(
    name
    for each in vars(protocols).values()
    if getattr(each, "_is_protocol", False)
    for name in (*vars(each), *getattr(each, "__annotations__", ()))
    if not name.startswith("_")
)
"""Names of the methods and attributes of all backend protocols."""

log = logging.getLogger("cobot.rtloop")


class ForeignError(BackendError):
    """Raised if a backend's method raises an exception other than `BackendError`, or returns an unusable
    value.
    """


class Guarded:
    """A wrapper with the methods and attributes of its backend. Compiled backends are not wrapped.

    Raises:
        ForeignError: raised by each method in place of any other exception, whose traceback is logged once.
    """

    def __init__(self, inner: Backend) -> None:
        self._inner, self._logged = inner, set[tuple[str, type]]()
        for name in NAMES:
            if hasattr(inner, name):
                found = getattr(inner, name)
                setattr(self, name, self._guarded(name) if callable(found) else found)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def _guarded(self, name: str) -> Callable[..., Any]:
        inner = self._inner

        def call(*arguments: Any) -> Any:
            try:
                return getattr(inner, name)(*arguments)
            except BackendError as exc:
                said = plain_text(exc)
                if type(exc) in (BackendError, ForeignError) and exc.args == (said,):
                    raise
                raise (ForeignError if isinstance(exc, ForeignError) else BackendError)(said) from exc
            except KeyboardInterrupt:
                raise
            except BaseException as exc:
                raise self._foreign(name, exc) from exc

        return call

    def _foreign(self, name: str, exc: BaseException) -> ForeignError:
        kind = type(exc)
        said = f"the backend's {name}() raised {plain_error(exc)}; a backend must raise BackendError"
        if (name, kind) not in self._logged:
            self._logged.add((name, kind))
            log.error("%s", said, exc_info=exc)
        return ForeignError(said)


def guarded(backend: Backend) -> Backend:
    """Wrap a backend so that its methods raise only `BackendError`."""
    return cast(Backend, Guarded(backend))
