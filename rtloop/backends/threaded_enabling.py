"""Enabling a device on another thread, so that the cycle never waits for the device."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from cobot.foreign import plain_error, plain_text
from rtloop.backends.protocols import BackendError, require_accepted
from rtloop.results import ACCEPTED, Accepted, Rejected

ENABLE_S = 20.0
"""Timeout for the device to be enabled, s. It is shorter than that of `POST /robot/reset`."""


@dataclass(slots=True)
class _Attempt:
    """Attributes:
    result: None until the thread has ended it.
    is_cancelled: whether the drives must be switched off after it.
    """

    begun_s: float = field(default_factory=time.monotonic)
    result: Accepted | Rejected | None = None
    is_cancelled: bool = False

    @property
    def waits(self) -> bool:
        return self.result is None and not self.is_cancelled


class ThreadedEnabling:
    """The cycle begins an attempt and looks at it in each step; the thread that polls the device performs it.

    An attempt that a stop has ended is still performed to its end. The next one begins after it.
    """

    def __init__(self, enable: Callable[[], None], disable: Callable[[], None]) -> None:
        self._enable, self._disable = enable, disable
        self._attempt: _Attempt | None = None

    def begin(self) -> None:
        """Begin a new attempt. Real-time safe, as are `is_done` and `cancel`."""
        self._attempt = _Attempt()

    def is_done(self) -> bool:
        """Whether the device is enabled; False while the attempt goes on.

        Raises:
            BackendError: the device cannot be enabled, or does not answer.
        """
        attempt = self._attempt
        if attempt is not None and attempt.result is not None:
            require_accepted(attempt.result)
            return True
        if attempt is not None and time.monotonic() - attempt.begun_s > ENABLE_S:
            raise BackendError(
                f"the device has not answered for {ENABLE_S:g} s: check that its driver runs, then reset"
            )
        return False

    def cancel(self) -> bool:
        """Have the drives switched off as soon as the current attempt has ended. Returns False if there is
        no current attempt.
        """
        attempt = self._attempt
        if attempt is not None:
            attempt.is_cancelled = True
        return attempt is not None and attempt.result is None

    def perform(self) -> None:
        """Perform the attempt, if one waits. Called by the thread."""
        attempt = self._attempt
        if attempt is None or not attempt.waits:
            return
        result: Accepted | Rejected = ACCEPTED
        try:
            self._enable()
        except BackendError as exc:
            result = Rejected(plain_text(exc))
        except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
            result = Rejected(plain_error(exc))
        attempt.result = result  # before the look at is_cancelled, which `cancel` sets before it looks here
        if attempt.is_cancelled:
            self._disable()
