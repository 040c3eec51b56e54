"""`python -m benchmarks.soak`: everything that can happen to an arm, at random; no limit may be violated.

The real cycle on the virtual clock: planned motions, streams of all kinds, rates and interpolations, and
servo sessions of all modes whose points come in bursts, with gaps and with wrong times, each brought to its
end by something else: a stop, an e-stop, a client that is killed, falls silent, jumps or streams what is no
number, a push at the tool, a device or a memory that breaks. What was commanded is read from the state block
in every cycle and compared with joint_limits.yaml.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections import Counter

import numpy as np
from faults import BLOCKS, FORCE_MODES, KINDS, Task, WatchedRig, spoil

from cobot.config import Settings, load_settings
from cobot.ipc.layout import Interpolation, ServoMode
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.quaternion import product
from cobot.types import Array, LoopMode
from rtloop.modes import STREAMING

MAX_TASK = 2500
"""Cycles, and as many more to come to rest."""
WAYS = ("smooth", "fast", "steps", "noise", "far")
PUSH_N, PUSH_NM = 60.0, 6.0
SENDERS = ("punctual", "bursts", "gaps", "wrong times")


class Wanderer(Task):
    """A task with random targets, some of which the arm cannot follow."""

    def __init__(self, rig: WatchedRig, kind: str, random: np.random.Generator, **wishes: object) -> None:
        self._random = random
        self.way_of_it = str(random.choice(WAYS))
        self._sizes = random.uniform(-1.0, 1.0, 7)
        self._rates_hz = random.uniform(0.1, 0.6, 7) * (4.0 if self.way_of_it == "fast" else 1.0)
        self._sender = str(random.choice(SENDERS))
        self._law = (0.0, 0.0) if random.random() < 0.5 else tuple(random.uniform([0.03, 100], [0.2, 2000]))
        self._held: list[Array] = []
        super().__init__(rig, kind, int(random.choice([1, 2, 5, 10, 20, 33, 100])), **wishes)

    def send(self, target: dict[str, Array]) -> None:
        if self.kind != "servo":
            super().send(target)
            return
        random, time_s = self._random, self.interval * self._period_s
        self._held.append(target["joints"])
        if self._sender in ("bursts", "gaps") and random.random() < 0.9:
            return
        if self._sender == "gaps":
            del self._held[:-1]
        if self._sender == "wrong times":
            time_s = float(random.choice([0.0, -1.0, 1e-4, time_s, 3.0 * time_s, 1e300]))
        for joints in self._held:
            self._points.put(joints.tolist(), time_s, *self._law)
        self._held.clear()

    def target(self) -> dict[str, Array]:
        time_s = self._cycle * self._period_s
        swing = (
            (3.0 if self.way_of_it == "far" else 0.5)
            * self._sizes
            * (1.0 - np.cos(2.0 * np.pi * self._rates_hz * time_s))
        )
        if self.way_of_it == "steps":
            swing = np.round(swing, 1)
        if self.way_of_it == "noise":
            swing = swing + self._random.normal(0.0, 0.02, 7)
        if self.kind in ("joint", "servo"):
            return {"joints": self._origin + 0.6 * swing}
        if self.kind == "torque":
            return {"joints": 6.0 * swing}
        pose = self._pose.copy()
        pose[:3] += 0.2 * swing[:3]
        turn = np.concatenate([[1.0], 0.3 * swing[3:6]])
        pose[3:] = product((turn / np.linalg.norm(turn)).tolist(), pose[3:].tolist())
        return {"pose": pose}


class Soak:
    """An arm that executes random tasks until the time is up.

    Attributes:
        counts: what has happened how often.
        violations: of limits, in words.
    """

    def __init__(self, settings: Settings, robot: RobotDescription, seed: int) -> None:
        self.rig = WatchedRig(settings, robot)
        self.counts: Counter[str] = Counter()
        self.violations: list[str] = []
        self.cycles = 0
        self._random = np.random.default_rng(seed)
        self._ends = {
            name.removeprefix("_end_by_"): getattr(self, name)
            for name in dir(self)
            if name.startswith("_end_by_")
        }

    def run(self, cycles: int) -> None:
        """Execute random tasks for this number of cycles, and check the cycles."""
        begin = self.rig.record.cycles[-1] if self.rig.record.cycles else 0
        while (done := self.rig.record.cycles[-1] - begin if self.rig.record.cycles else 0) < cycles:
            what = self._one_task()
            self.violations += [f"{what}: {found}" for found in self.rig.record.violations()]
            self.rig.record.forget()
            self.rig.commanded.clear()
            self.rig.path_times.clear()
        self.cycles += done

    def close(self) -> None:
        self.rig.close()

    def _one_task(self) -> str:
        """Execute one task. Returns its description in words."""
        random, rig = self._random, self.rig
        kind, how = str(random.choice(KINDS)), str(random.choice(list(self._ends)))
        self.counts[kind] += 1
        self.counts[f"ended by {how}"] += 1
        wishes: dict[str, object] = {} if kind == "motion" else self._wishes()
        if kind == "servo":
            wishes |= self._servo_wishes()
        client = None
        if how == "kill" and kind != "motion":
            client = subprocess.Popen(["sleep", "600"])
            wishes["pid"] = client.pid
        task = Wanderer(rig, kind, random, **wishes)
        if kind == "servo":  # what the force modes shall exert
            rig.aim()
        task.step(int(random.integers(1, MAX_TASK)))
        if client is not None:
            client.kill()
            client.wait()
        self._ends[how](task)
        self._recover(task)
        return f"{task.way_of_it} {kind} with {wishes}, ended by {how}"

    def _wishes(self) -> dict[str, object]:
        random = self._random
        wishes: dict[str, object] = {"interpolation": int(random.choice(list(Interpolation)))}
        if random.random() < 0.5:
            wishes["stiffness"] = random.uniform(100.0, 500.0)
            wishes["damping_ratio"] = random.uniform(0.3, 1.0)
        if random.random() < 0.3:
            wishes["max_contact_wrench"] = 40.0
        return wishes

    def _servo_wishes(self) -> dict[str, object]:
        random, mode = self._random, ServoMode(int(self._random.integers(1, len(ServoMode))))
        self.counts[f"servo mode {mode}"] += 1
        wishes: dict[str, object] = {"servo_mode": mode, "watchdog_s": random.choice([0.1, 0.5, 5.0])}
        if mode in FORCE_MODES:
            wishes["force_axes"] = random.integers(0, 2, 6).astype(float)
            wishes["force_velocity"] = [0.1] * 3 + [0.5] * 3
            self.rig.memory.setpoint.data["wrench"] = random.uniform(-1.0, 1.0, 6) * ([20.0] * 3 + [2.0] * 3)
        return wishes

    def _recover(self, task: Task) -> None:
        """Return to HOLD in the same way as a user."""
        rig = self.rig
        rig.simulation.push[:] = 0.0
        if rig.mode in STREAMING:
            rig.end_stream()
        rig.run()
        if rig.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            self.counts[rig.mode.name] += 1
            refusal = rig.reset()
            if refusal:
                self.violations.append(f"no reset: {refusal}")
        rig.step(int(self._random.integers(1, 200)))
        if rig.mode is not LoopMode.HOLD:
            self.violations.append(f"no recovery: mode {rig.mode.name}, {rig.reason}")

    def _end_by_itself(self, task: Task) -> None:
        task.end()

    def _end_by_kill(self, task: Task) -> None:
        task.step(100)

    def _end_by_stop(self, task: Task) -> None:
        self.rig.request("stops")
        task.step(100)

    def _end_by_estop(self, task: Task) -> None:
        self.rig.request("estops")
        task.step(100)

    def _end_by_client_estop(self, task: Task) -> None:
        self.rig.memory.stream_requests.data["estops"] += 1
        self.rig.memory.stream_requests.publish()
        task.step(100)

    def _end_by_silence(self, task: Task) -> None:
        self.rig.step(int(self._random.integers(1, 1500)))
        task.step(100)

    def _end_by_jump(self, task: Task) -> None:
        if task.kind == "motion":
            return
        wild = task.target()
        for value in wild.values():
            value[:3] += self._random.normal(0.0, 0.3, 3)
        task.send(wild)
        self.rig.step(task.interval)  # or the next one replaces it before it is taken
        task.step(300)

    def _end_by_no_number(self, task: Task) -> None:
        if task.kind == "motion":
            return
        wild = task.target()
        for value in wild.values():
            value[self._random.integers(7)] = self._random.choice([np.nan, np.inf, -np.inf])
        task.send(wild)
        self.rig.step(task.interval)
        task.step(100)

    def _end_by_push(self, task: Task) -> None:
        push = self._random.uniform(-1.0, 1.0, 6) * ([PUSH_N] * 3 + [PUSH_NM] * 3)
        for share in np.linspace(0.0, 1.0, 100):
            self.rig.simulation.push[:] = share * push
            task.step()
        task.step(int(self._random.integers(1, 1000)))

    def _end_by_device(self, task: Task) -> None:
        device = self.rig.simulation
        name, value, good = (
            ("fail_read", "no answer", ""),
            ("fail_write", "no answer", ""),
            ("drive_fault", "too hot", ""),
            ("stale", True, False),
            ("not_finite", True, False),
            ("jump", self._random.normal(0.0, 0.1, 7), np.zeros(7)),
        )[self._random.integers(6)]
        self.counts[name] += 1
        setattr(device, name, value)
        task.step(int(self._random.choice([1, 10, 100, 1000])))
        setattr(device, name, good)
        task.step(10)

    def _end_by_late_cycles(self, task: Task) -> None:
        self.rig.step(int(self._random.integers(1, 40)), late_ns=int(self._random.choice([2e6, 2e8])))
        task.step(100)

    def _end_by_wild_writer(self, task: Task) -> None:
        for _ in range(10):
            spoil(self.rig.memory, str(self._random.choice(BLOCKS)), self._random)
            task.step(int(self._random.integers(1, 50)))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="of robot time")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    np.seterr(all="ignore")
    settings = load_settings()
    soak = Soak(settings, load_robot(settings), arguments.seed)
    begun_s = time.monotonic()
    soak.run(round(60.0 * arguments.minutes / settings.rt.period_s))
    took_s = time.monotonic() - begun_s
    robot_s = soak.cycles * settings.rt.period_s
    print(f"seed {arguments.seed}: {robot_s:.0f} s of robot time in {took_s:.0f} s")
    print(", ".join(f"{count} {name}" for name, count in sorted(soak.counts.items())))
    print("interventions:", ", ".join(f"{n} {name}" for name, n in soak.rig.counted().items()))
    print("\n".join(soak.violations[:20]))
    print(f"{len(soak.violations)} violations")
    soak.close()
    return 1 if soak.violations else 0


if __name__ == "__main__":
    sys.exit(main())
