class CycleClock:
    """Paces the cycle. Real-time safe.

    Attributes:
        overruns: periods that were missed because a cycle began too late.
    """

    overruns: int
    def wait(self, *, moving: bool) -> int: ...

class RealtimeClock(CycleClock):
    _deadline_ns: int
    def __init__(self, period_s: float) -> None: ...

class FastClock(CycleClock):
    def __init__(self, period_s: float) -> None: ...

class Pace:
    """Holds a device's beats against the computer's clock."""

    beats: int
    beats_ns: int
    def __init__(self, period_s: float) -> None: ...
    def early_ns(self, now_ns: int, beaten: bool) -> int: ...
