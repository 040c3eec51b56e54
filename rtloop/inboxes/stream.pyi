import numpy as np

from cobot.ipc.seqlock import Block
from cobot.ipc.shm import RobotMemory
from rtloop.results import Accepted, Rejected

class Inbox:
    """A block of another process, read when it has changed. Real-time safe.

    Attributes:
        readable: whether `data` is consistent; if not, the next cycle reads it again.
        torn_reads: how often it was not consistent.
    """

    readable: bool
    torn_reads: int
    def __init__(self, block: Block) -> None: ...
    @property
    def data(self) -> np.ndarray: ...
    def take_news(self) -> bool: ...

class StreamInbox:
    """The blocks of the streaming client. Real-time safe.

    Attributes:
        session, setpoint, chunk: what it wants, see `cobot.ipc.layout`.
        session_seen: number of the session that was answered last.
    """

    session: Inbox
    setpoint: Inbox
    chunk: Inbox
    session_seen: int
    def __init__(self, memory: RobotMemory) -> None: ...
    @property
    def torn_reads(self) -> int: ...
    @property
    def finishes(self) -> bool: ...
    def asks(self) -> bool: ...
    def wants(self, number: int) -> bool: ...
    def take_estop(self) -> bool: ...
    def answer(self, result: Accepted | Rejected) -> None: ...
