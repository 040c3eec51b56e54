import numpy as np

from cobot.ipc.layout import Ack
from cobot.ipc.shm import RobotMemory
from rtloop.results import Result

UNREADABLE_CYCLES: int

class CommandInbox:
    """Reads requests, heartbeat and commands; each costs next to nothing while it does not change.

    Real-time safe. A read that is torn is counted and repeated in the next cycle.

    Attributes:
        stops, estops: the counters of requests seen so far.
        command_seen: the number of the last command taken.
        torn_reads: how often a block was not consistent.
    """

    stops: int
    estops: int
    command_seen: int
    def __init__(self, memory: RobotMemory) -> None: ...
    @property
    def torn_reads(self) -> int: ...
    def poll_requests(self) -> tuple[bool, bool]: ...
    def service_silence_s(self, now_ns: int) -> float: ...
    def next_command(self) -> np.ndarray | None: ...
    def refuse_pending(self, reason: str) -> None: ...
    def acknowledge(self, number: int, result: Ack, message: str = "") -> None: ...
    def answer(self, number: int, result: Result) -> None: ...
