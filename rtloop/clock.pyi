class CycleClock:
    """Paces the cycle. Real-time safe.

    Attributes:
        overruns: periods that were missed because a cycle began too late.
        factor: the time factor, robot time per wall time while a planned motion runs.
    """

    overruns: int
    @property
    def factor(self) -> float: ...
    def scale(self, factor: float) -> None: ...
    def wait(self, *, moving: bool, planned: bool = False) -> int: ...

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
