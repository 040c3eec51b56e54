import numpy as np

from cobot.ipc.shm import RobotMemory

UNREADABLE_CYCLES: int

class PointQueue:
    """Reads the ring of points. Real-time safe.

    Attributes:
        newest: the number of the newest point.
        seen: the number of the point read last.
        lost: points that could not be read.
        torn_reads: how often a block was not consistent.
    """

    newest: int
    seen: int
    lost: int
    def __init__(self, memory: RobotMemory) -> None: ...
    @property
    def torn_reads(self) -> int: ...
    @property
    def waiting(self) -> int: ...
    def begin(self, session: int) -> None: ...
    def poll(self) -> bool: ...
    def next(self) -> np.ndarray | None: ...
