from cobot.ipc.recording_memory import RecordingMemory
from cobot.types import Array
from rtloop.safety.limiter import Safety

class CycleRecorder:
    def __init__(self, memory: RecordingMemory) -> None: ...
    def heed(self, safety: Safety, reason: str, mode: int, cycle: int, now_ns: int) -> None: ...
    def record(
        self,
        scalars: Array,
        measured_values: Array,
        command: Array,
        tcp: Array,
        phases_ns: Array,
        *,
        fresh: bool,
    ) -> None: ...
