"""What the service knows of a robot at one moment: everything of it, so that nobody looks behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.ipc.layout import STATE_SCALARS, STATE_STRUCT, MotionResult, text
from cobot.types import Array, LoopMode

SCALARS = [name for name, _ in STATE_SCALARS]


@dataclass(slots=True)
class RobotState:
    """A copy of rtloop's state block: rad, rad/s, N·m, shape (dof,) each.

    Attributes:
        tcp: shape (7,): x, y, z in m, then w, x, y, z, in the base frame, as measured.
        wrench: shape (6,), N and N·m: what the surroundings do to the TCP, as estimated, in the base frame.
        path_time_s, path_duration_s: how far along its path the motion is, and how long that is.
        path_rate: path time per clock time, 0 at rest to 1 at full speed.
        published_s: when it was published, on the link's clock.
        age_s: how long ago that was.
        measured_age_s: how long ago the robot was read.
        session: the streaming session that moves the arm, 0 for none.
        points_taken, points_dropped, points_buffered: servo points that the session has gone for, that it
            could not go for, and that are still ahead of it.
        underruns: how often the session had to wait for a servo point.
        interventions: in the order of `Intervention`.
        intervened_ns: when each was counted last, CLOCK_MONOTONIC; 0 for never.
        reason: why the mode is ESTOP or FAULT, or why the last motion ended.
    """

    mode: LoopMode
    settled: bool
    position: Array
    velocity: Array
    effort: Array
    commanded_position: Array
    tcp: Array
    wrench: Array
    motion_id: int
    motion_result: MotionResult
    path_time_s: float
    path_duration_s: float
    path_rate: float
    stops_seen: int
    session: int
    points_taken: int
    points_dropped: int
    points_buffered: int
    underruns: int
    interventions: list[int]
    intervened_ns: list[int]
    overruns: int
    torn_reads: int
    published_s: float
    age_s: float
    measured_age_s: float
    reason: str


def robot_state(record: np.ndarray, octets: memoryview, now_ns: int) -> RobotState:
    """A copy of what has just been read.

    Args:
        record: of `cobot.ipc.layout.state_dtype`.
        octets: the same; a struct reads the scalars many times as fast as numpy does.
        now_ns: CLOCK_MONOTONIC, which its ages are counted up to.
    """
    scalars = dict(zip(SCALARS, STATE_STRUCT.unpack_from(octets), strict=True))
    return RobotState(
        mode=LoopMode(scalars["mode"]),
        settled=bool(scalars["settled"]),
        position=record["position"].copy(),
        velocity=record["velocity"].copy(),
        effort=record["effort"].copy(),
        commanded_position=record["commanded_position"].copy(),
        tcp=record["tcp"].copy(),
        wrench=record["wrench"].copy(),
        motion_id=scalars["motion_id"],
        motion_result=MotionResult(scalars["motion_result"]),
        path_time_s=scalars["path_time_s"],
        path_duration_s=scalars["path_duration_s"],
        path_rate=scalars["path_rate"],
        stops_seen=scalars["stops_seen"],
        session=scalars["session"],
        points_taken=scalars["points_taken"],
        points_dropped=scalars["points_dropped"],
        points_buffered=scalars["points_buffered"],
        underruns=scalars["underruns"],
        interventions=record["interventions"].tolist(),
        intervened_ns=record["intervened_ns"].tolist(),
        overruns=scalars["overruns"],
        torn_reads=scalars["torn_reads"],
        published_s=scalars["monotonic_ns"] * 1e-9,
        age_s=(now_ns - scalars["monotonic_ns"]) * 1e-9,
        measured_age_s=(now_ns - scalars["measured_monotonic_ns"]) * 1e-9,
        reason=text(record["reason"]),
    )
