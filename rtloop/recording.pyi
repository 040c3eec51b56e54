import numpy as np

from cobot.ipc.recording_memory import RecordingMemory
from rtloop.safety.limiter import Safety

class CycleRecorder:
    def __init__(self, memory: RecordingMemory) -> None: ...
    def heed(self, safety: Safety, reason: str, mode: int, cycle: int, now_ns: int) -> None: ...
    def record(
        self,
        state: np.ndarray,
        phases_ns: np.ndarray,
        *,
        fresh: bool,
    ) -> None: ...
