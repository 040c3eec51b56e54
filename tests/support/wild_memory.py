"""The whole compiled cycle, in every mode, while somebody writes anything into its shared memory.

python -m wild CYCLES SEED between|beside loopback|simulated

Random bytes come between the cycles, from a seed, or from a process beside it that writes all the time
(`wild_writer`). Prints how many cycles there were, of how many things that the arm was to do, and which modes
it was often in; then each limit that was not kept, a line each.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from cobot_run import HELPER_ENVIRONMENT
from faults import BLOCKS, FORCE_MODES, Task, WatchedRig, spoil
from wild_writer import ASKS, Writer, all_blocks

from cobot.config import load_settings
from cobot.ipc.layout import Command, Interpolation, ServoMode
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import load_robot
from cobot.trajectory import Trajectory
from cobot.trajectory_parts import remainder_at
from cobot.types import LoopMode

KINDS = ("hold", "motion", "replaced", "joint", "cartesian", "torque", *(mode for mode in ServoMode if mode))
LASTS = 150
"""Cycles of one thing, before the next."""
COMES_TO_REST = 3000
OFTEN = 100


class WildRig(WatchedRig):
    """A loop whose memory is written by a stranger; what it does is recorded from its inside."""

    def __init__(self, simulated: bool) -> None:
        settings, self._simulated = load_settings(), simulated
        self.disturb: Callable[[], None] = lambda: None
        self.modes: Counter[LoopMode] = Counter()
        self.cycles = 0
        super().__init__(settings, load_robot(settings), simulated=simulated)

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        controller = self.loop.controller
        for _ in range(cycles):
            place = self.simulation._data.qpos if self._simulated else self.loopback.measured.position
            truth = place.copy()  # where the arm was when this cycle began
            self.disturb()
            self.loop.step(late_ns)
            self.cycles += 1
            mode, position = controller.mode, controller.safety.position
            self.modes[mode] += 1
            self.record.note(self.cycles, mode, position, truth, controller.streaming.session)

    def clean(self) -> None:
        """What a service and a client know again, whatever stands in the blocks."""
        commands, memory = self.loop.controller.commands, self.memory
        memory.requests.data["stops"], memory.requests.data["estops"] = commands.stops, commands.estops
        self._command = commands.command_seen
        memory.head.data["id"] = self._command
        for name in ("requests", "head", "stream_requests"):
            getattr(memory, name).publish()
        for name in ("setpoint", "chunk", "point_head"):
            block = getattr(memory, name)
            block.data[...] = np.zeros((), block.data.dtype)
            block.publish()
        memory.session.data[...] = np.zeros((), memory.session.data.dtype)
        memory.session.data["number"] = self.loop.controller.streaming.box.session_seen + np.uint64(1)
        memory.session.publish()
        self.beat()

    def come_home(self) -> None:
        """To HOLD, and once more when a stop was meant for what is over."""
        self.clean()
        for _ in range(COMES_TO_REST):
            self.step()
            if not self.loop.controller.moving:
                break
        self._command = self.loop.controller.commands.command_seen  # it has known of one more
        if self.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            assert self.answer(self.send(Command.RESET)) == ""
        self.step()
        assert self.mode is LoopMode.HOLD, (self.mode, self.reason)


class Replaced(Task):
    """A motion that is told again and again to go on with itself, or with what is left of it."""

    def __init__(self, rig: WildRig, random: np.random.Generator) -> None:
        super().__init__(rig, "motion")
        slot = rig.memory.slots[0]
        count = int(slot.head.data["segments"])
        self._motion = Trajectory(slot.breakpoints_s[: count + 1].copy(), slot.coefficients[:count].copy())
        self._random = random

    def step(self, cycles: int = 1) -> None:
        super().step(cycles)
        if self._random.integers(10):
            return
        controller = self.rig.loop.controller
        whole = bool(self._random.integers(2))
        left, offset_s = remainder_at(self._motion, 0.0 if whole else controller.clock.path_time_s)
        slot = int(self._random.integers(2))
        self.rig.memory.slots[slot].write(controller.motion_id, left)
        self.rig.send(Command.REPLACE, slot=slot, motion_id=controller.motion_id, value=offset_s)


def make_task(rig: WildRig, kind: str | ServoMode, random: np.random.Generator) -> Task | None:
    if kind == "hold":
        return None
    interval = int(random.choice([1, 10]))
    if isinstance(kind, ServoMode):
        force = [0.0, 0.0, float(random.integers(2)), 0.0, 0.0, 0.0] if kind in FORCE_MODES else [0.0] * 6
        return Task(rig, "servo", interval, servo_mode=kind, force_axes=force)
    if kind == "motion":
        return Task(rig, kind)
    if kind == "replaced":
        return Replaced(rig, random)
    return Task(rig, kind, interval, interpolation=Interpolation(int(random.integers(4))))


class Stranger:
    """Random bytes between the cycles: torn, right but for their content, or with one field that is wrong."""

    def __init__(self, memory: RobotMemory, random: np.random.Generator) -> None:
        self._memory, self._random, self._writer = memory, random, Writer(random)
        self._blocks = all_blocks(memory)
        self._asks = [getattr(memory, name) for name in ASKS]

    def __call__(self) -> None:
        random = self._random
        match int(random.integers(12)):
            case 0:
                spoil(self._memory, str(random.choice(BLOCKS)), random)
            case 1 | 2:
                self._scribble(self._blocks[random.integers(len(self._blocks))])
            case 3 | 4:
                self._writer.disturb(self._blocks[random.integers(len(self._blocks))])
            case 5 | 6:
                self._forge(self._memory.setpoint)
            case 7:
                self._forge(self._memory.chunk)
            case 8:
                self._forge(self._memory.points[random.integers(40)])

    def _scribble(self, block: Block) -> None:
        if not any(block is each for each in self._asks) or self._random.random() < 0.02:
            self._writer.scribble(block)

    def _forge(self, block: Block) -> None:
        """What was written last, but for some bits or one number."""
        random = self._random
        if not block.try_read():
            return
        names = block.data.dtype.names or ()
        field = block.data[random.choice(names)]
        if random.random() < 0.5:
            place = int(random.integers(len(block.buffer)))
            block.buffer[place] ^= 1 << int(random.integers(8))
        elif field.ndim and field.dtype.kind == "f":
            field.flat[random.integers(field.size)] = random.choice(
                [np.nan, np.inf, 1e300, -1e-300, 0.3, 7.0]
            )
        block.publish()


class Beside:
    """Another process that writes without end; it pauses while something is asked for."""

    def __init__(self, robot: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "wild_writer", robot, "pester"], env=HELPER_ENVIRONMENT
        )
        self.pause()

    def pause(self) -> None:
        self.process.send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        self.process.send_signal(signal.SIGCONT)

    def end(self) -> None:
        assert self.process.poll() is None, "the writer has ended by itself"
        self.process.kill()
        self.process.wait()


def run(cycles: int, seed: int, has_writer: bool, simulated: bool) -> None:
    random = np.random.default_rng(seed)
    rig = WildRig(simulated)
    beside = Beside(rig.memory.robot) if has_writer else None
    stranger = Stranger(rig.memory, random)
    began: Counter[str] = Counter()
    found: list[str] = []
    rounds: list[int] = []  # each round has each kind once
    try:
        while rig.cycles < cycles:
            kind = KINDS[(rounds := rounds or random.permutation(len(KINDS)).tolist()).pop()]
            rig.come_home()
            task = make_task(rig, kind, random)
            began[str(kind)] += 1
            with disturbed(rig, stranger, beside):
                for _ in range(LASTS):
                    (rig if task is None else task).step()
            if len(rig.record.cycles) > 20_000:
                found += rig.record.violations()
                rig.record.forget()
        rig.come_home()
        found += rig.record.violations()
    finally:
        if beside is not None:
            beside.end()
        rig.close()
    often = [mode.name for mode, count in rig.modes.items() if count > OFTEN]
    print(rig.cycles, len(began), *often)
    print(*found, sep="\n", end="")


@contextmanager
def disturbed(rig: WildRig, stranger: Stranger, beside: Beside | None) -> Iterator[None]:
    """While the arm does something, somebody writes."""
    if beside is None:
        rig.disturb = stranger
        yield
        rig.disturb = lambda: None
    else:
        beside.resume()
        yield
        beside.pause()


if __name__ == "__main__":
    with np.errstate(all="ignore"):
        run(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == "beside", sys.argv[4] == "simulated")
