"""Enables a device in a separate thread, so that the cycle never waits for the device."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from cobot.foreign import plain_error, plain_text
from rtloop.backends.protocols import BackendError, require_accepted
from rtloop.results import ACCEPTED, Accepted, Rejected

ENABLE_S = 20.0
"""Timeout for enabling the device, s. A test checks that the timeout of `POST /robot/reset` is longer."""
MAX_LOOK_AGE_S = 0.5
"""Maximum time since the cycle last asked for the result of a waiting attempt, s. After a stop or a timeout,
the cycle no longer asks, so a device that answers later is not switched on unexpectedly.
"""


@dataclass(slots=True)
class _Attempt:
    """An attempt to enable the device.

    Attributes:
        begun_s, looked_s: times at which the attempt began and at which the cycle last asked for its result,
            on the monotonic clock.
        result: result of the attempt; None until it has ended.
        is_cancelled: whether the drives must be switched off after the attempt.
        is_off: whether the drives have been switched off after the attempt.
    """

    begun_s: float = field(default_factory=time.monotonic)
    looked_s: float = field(default_factory=time.monotonic)
    result: Accepted | Rejected | None = None
    is_cancelled: bool = False
    is_off: bool = False

    @property
    def waits(self) -> bool:
        is_awaited = time.monotonic() - self.looked_s < MAX_LOOK_AGE_S
        return self.result is None and not self.is_cancelled and is_awaited

    @property
    def is_switching_off(self) -> bool:
        return self.is_cancelled and not self.is_off


class ThreadedEnabling:
    """Enables a device in the thread that polls it. The cycle begins an attempt, and asks for its result in
    each step.

    The thread always completes an attempt that it has begun, even after a stop, before it begins the next
    one.
    """

    def __init__(self, enable: Callable[[], None], disable: Callable[[], bool]) -> None:
        """`enable` enables the device. `disable` switches the drives off, and returns whether it has
        succeeded.
        """
        self._enable, self._disable = enable, disable
        self._attempt: _Attempt | None = None

    def begin(self) -> None:
        """Begin a new attempt. Real-time safe, as are the other methods, except `perform`."""
        self._attempt = _Attempt()

    def is_done(self) -> bool:
        """Whether the device is enabled. False while the attempt is in progress.

        Raises:
            BackendError: the device cannot be enabled, or does not answer.
        """
        attempt = self._attempt
        if attempt is None:
            return False
        attempt.looked_s = time.monotonic()
        if attempt.result is not None:
            require_accepted(attempt.result)
            return True
        if attempt.looked_s - attempt.begun_s > ENABLE_S:
            raise BackendError(
                f"the device has not answered for {ENABLE_S:g} s: check that its driver is running, "
                "then reset"
            )
        return False

    def cancel(self) -> bool:
        """Let the thread switch the drives off as soon as the current attempt and any earlier one have ended.
        Returns False if there is no current attempt.
        """
        attempt = self._attempt
        if attempt is None:
            return False
        attempt.is_cancelled = True
        if attempt.result is None:
            return True
        attempt.is_off = True  # the caller switches the drives off
        return False

    def is_switching_off(self) -> bool:
        """Whether the thread must still switch the drives off after a cancelled attempt."""
        attempt = self._attempt
        return attempt is not None and attempt.is_switching_off

    def perform(self) -> None:
        """Carry out the waiting attempt, if any, and switch the drives off after a cancelled attempt. If they
        cannot be switched off, the next call tries again. Called in the thread.
        """
        attempt = self._attempt
        if attempt is None:
            return
        if attempt.waits:
            # Set the result before reading is_cancelled. `cancel` does the reverse: it sets is_cancelled,
            # then reads the result.
            attempt.result = self._result()
        if attempt.is_switching_off:
            attempt.is_off = self._disable()

    def _result(self) -> Accepted | Rejected:
        try:
            self._enable()
        except BackendError as exc:
            return Rejected(plain_text(exc))
        except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
            return Rejected(plain_error(exc))
        return ACCEPTED
