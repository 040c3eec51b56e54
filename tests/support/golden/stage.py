"""Plays a scenario and writes down what the arm was told.

Everything that a trace holds is read by `observe` and `outcome`, from the state block that rtloop publishes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from folders import TESTS
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import Stream, text
from cobot.ipc.shm import RobotMemory
from cobot.ipc.stream_writer import PointWriter
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array

FOLDER = TESTS / "rtloop" / "golden"
TRACES = FOLDER / "traces.npz"
INPUTS = FOLDER / "inputs.npz"
EVERY = 13
"""Cycles between two rows of a trace."""
MEASURED_EVERY = 65
SILENT_S = 1000.02
"""So long the service has been silent when it is: far from where the sentence about it rounds."""
COUNTS = (
    "settled",
    "motion_id",
    "motion_result",
    "slot",
    "stops_seen",
    "estops_seen",
    "command_seen",
    "session",
    "setpoint_seen",
    "move_seen",
    "move_running",
    "chunk_seen",
    "point_seen",
    "points_taken",
    "points_dropped",
    "points_buffered",
    "underruns",
    "torn_reads",
)
Scenario = Callable[["Stage"], None]


@dataclass(frozen=True, slots=True)
class Row:
    """What is seen in a cycle: the command, shape (3, dof), rad, rad/s, rad/s²; mode; path time, s."""

    command: Array
    mode: int
    path_time_s: float


def observe(rig: Rig) -> Row:
    """What a trace holds of a cycle."""
    state = rig.memory.state.read()
    rows = [state[f"commanded_{what}"] for what in ("position", "velocity", "acceleration")]
    return Row(np.array(rows), int(state["mode"]), float(state["path_time_s"]))


def measured(rig: Rig) -> Array:
    """Position, external effort and wrench, shape (2 dof + 6,): rad, N·m, N and N·m."""
    state = rig.memory.state.read()
    return np.concatenate([state["position"], state["external_effort"], state["wrench"]])


def outcome(rig: Rig) -> tuple[list[int], str]:
    """How it ended: `COUNTS`, then the interventions; and the reason in words."""
    state = rig.memory.state.read()
    counts = [int(state[name]) for name in COUNTS]
    return counts + [int(number) for number in state["interventions"]], text(state["reason"])


@dataclass
class Trace:
    """What was seen of a scenario."""

    rows: list[Row] = field(default_factory=list)
    measured: list[Array] = field(default_factory=list)
    words: list[str] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    cycles: int = 0

    def arrays(self) -> dict[str, np.ndarray]:
        """For a file."""
        return {
            "commands": np.array([row.command for row in self.rows]),
            "modes": np.array([row.mode for row in self.rows], np.uint8),
            "path_times": np.array([row.path_time_s for row in self.rows]),
            "measured": np.array(self.measured),
            "counts": np.array(self.counts, np.uint64),
            "words": np.array("\n".join(self.words)),
            "cycles": np.array(self.cycles),
        }


class Stage(Rig):
    """A rig that writes down each `EVERY`th cycle, however it is stepped."""

    def __init__(
        self,
        settings: Settings,
        robot: RobotDescription,
        inputs: dict[str, Array],
        *,
        simulated: bool = False,
        memory: RobotMemory | None = None,
        start: Array | None = None,
        trace: Trace | None = None,
    ) -> None:
        self.trace = trace or Trace()
        self.inputs = inputs
        self.simulated = simulated
        self.writer: PointWriter | None = None
        super().__init__(settings, robot, simulated=simulated, memory=memory, start=start)

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        trace = self.trace
        for _ in range(cycles):
            super().step(1, late_ns)
            if trace.cycles % EVERY == 0:
                trace.rows.append(observe(self))
            if self.simulated and trace.cycles % MEASURED_EVERY == 0:
                trace.measured.append(measured(self))
            trace.cycles += 1

    def say(self, words: str) -> None:
        """Have an answer, or a refusal, in the trace."""
        self.trace.words.append(words)

    def finish(self) -> None:
        """The last cycle, and how it ended."""
        trace = self.trace
        trace.rows.append(observe(self))
        trace.measured.append(measured(self))
        trace.counts, reason = outcome(self)
        trace.words.append(reason.replace(" -0.000 ", " 0.000 "))  # a sign of rounding

    def trajectory(self, name: str) -> Trajectory:
        """A motion as it was planned when the inputs were made."""
        return Trajectory(self.inputs[f"{name}.times"], self.inputs[f"{name}.coefficients"])

    def go(self, name: str, cycles: int = 0, slot: int = 0) -> None:
        """Start a motion, and follow it for so long."""
        self.say(self.start(self.trajectory(name), slot))
        self.step(cycles)

    def session(self, stream: Stream = Stream.JOINT_IMPEDANCE, **wishes: object) -> None:
        """Open a session, and say what the answer was."""
        self.say(self.stream(stream, **wishes))

    def serve(self, mode: int, watchdog_s: float = 0.5, **wishes: object) -> PointWriter:
        """Open a servo session; what writes its points."""
        stream = Stream.CARTESIAN if mode >= 6 else Stream.JOINT_IMPEDANCE
        self.session(stream, servo_mode=mode, watchdog_s=watchdog_s, **wishes)
        writer = PointWriter(self.memory)
        writer.begin(int(self.memory.session.data["number"]))
        return writer

    def fall_silent(self) -> None:
        """The service has not been heard of for a long time."""
        self.beat(-SILENT_S)

    def client_estop(self) -> None:
        self.memory.stream_requests.data["estops"] += 1
        self.memory.stream_requests.publish()

    def send_chunk(self, times_s: Array, points: Array) -> None:
        chunk = self.memory.chunk.data
        chunk["session"] = self.memory.session.data["number"]
        chunk["number"] += 1
        chunk["count"] = len(times_s)
        chunk["times_s"][: len(times_s)] = times_s
        chunk["points"][: len(times_s), : points.shape[1]] = points
        self.memory.chunk.publish()

    @property
    def now_s(self) -> float:
        return float(self.memory.state.read()["robot_time_s"])


@dataclass(frozen=True, slots=True)
class Entry:
    """A scenario, and on what stage it is played.

    Attributes:
        simulated: with MuJoCo's arm instead of one that is always where it is told to be.
        start: the input that says where the joints start, "" for home.
    """

    play: Scenario
    simulated: bool
    start: str


SCENARIOS: dict[str, Entry] = {}


def scenario(*, simulated: bool = False, start: str = "", name: str = "") -> Callable[[Scenario], Scenario]:
    """Make a function one of the scenarios."""

    def add(play: Scenario) -> Scenario:
        called = name or play.__name__
        assert called not in SCENARIOS, called
        SCENARIOS[called] = Entry(play, simulated, start)
        return play

    return add


def load_inputs() -> dict[str, Array]:
    with np.load(INPUTS) as file:
        return {name: file[name] for name in file.files}


def play(
    settings: Settings,
    robot: RobotDescription,
    inputs: dict[str, Array],
    name: str,
    shift: Array | float = 0.0,
) -> dict[str, np.ndarray]:
    """What comes of a scenario.

    Args:
        shift: added to where the joints start, shape (dof,), rad: it shows how much a scenario magnifies.
    """
    entry = SCENARIOS[name]
    start = inputs[entry.start] if entry.start else np.array(robot.positions["home"].joints)
    with np.errstate(all="ignore"):
        stage = Stage(settings, robot, inputs, simulated=entry.simulated, start=start + shift)
        try:
            entry.play(stage)
            stage.finish()
            return stage.trace.arrays()
        finally:
            stage.close()
