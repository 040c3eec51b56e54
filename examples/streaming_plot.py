"""Plot how the arm follows a policy with each interpolation (linear, quintic, ruckig) and with action chunks.

On the robot's computer, install matplotlib, start the service in another terminal, and run the example:

    make setup-test
    make run
    .venv/bin/python examples/streaming_plot.py --rate 10 --output streaming.png

It moves the first joint by a few degrees, four times, and records the commands of the real-time loop.
"""

from __future__ import annotations

import argparse
import os
import threading
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cobot import Mode, Robot
from cobot.ipc.shm import MemoryRole, RobotMemory

JOINT = 0
AHEAD_S = 0.5  # length of an action chunk, s
WAYS = ("linear", "quintic", "ruckig", "chunks")


def path(time_s: np.ndarray | float, duration_s: float) -> np.ndarray:
    """Return the policy's targets, rad from the joint's initial position. The path starts and ends at
    rest.
    """
    time_s = np.clip(time_s, 0.0, duration_s)
    wave = 0.15 * np.sin(0.6 * np.pi * time_s) + 0.03 * np.sin(1.8 * np.pi * time_s)
    return np.sin(np.pi * time_s / duration_s) ** 4 * wave


class Recorder(threading.Thread):
    """Records each cycle from shared memory: robot time, position, velocity and acceleration."""

    def __init__(self, robot_name: str) -> None:
        super().__init__(daemon=True)
        self.rows: list[tuple[float, float, float, float]] = []
        self._memory = RobotMemory.attach(robot_name, MemoryRole.READER)
        self._end = threading.Event()

    def run(self) -> None:
        while not self._end.wait(0.0003):
            state = self._memory.state.read()
            time_s = float(state["robot_time_s"])
            if not self.rows or time_s > self.rows[-1][0]:
                rates = (
                    state[f"commanded_{name}"][JOINT] for name in ("position", "velocity", "acceleration")
                )
                self.rows.append((time_s, *map(float, rates)))

    def end(self) -> np.ndarray:
        self._end.set()
        self.join()
        return np.array(self.rows).T


def follow(name: str, way: str, rate_hz: int, duration_s: float) -> np.ndarray:
    """Follow the policy in one session. Returns the commands, shape (4, n), from time 0."""
    with Robot(name) as robot:
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        interpolation = "linear" if way == "chunks" else way
        with robot.start_joint_impedance_control(rate_hz, interpolation=interpolation) as control:
            start = np.array(control.get_state().q)
            moved = np.eye(len(start))[JOINT]
            recorder = Recorder(name)
            recorder.start()
            begun_s, due_s = robot.clock_s(), time.monotonic()
            while (now_s := robot.clock_s() - begun_s) < duration_s:
                if way == "chunks":
                    ahead_s = now_s + np.arange(0.0, AHEAD_S, 1.0 / rate_hz)
                    points = start + np.outer(path(ahead_s, duration_s), moved)
                    control.set_chunk((begun_s + ahead_s).tolist(), points.tolist())
                else:
                    control.set_target_joints((start + path(now_s, duration_s) * moved).tolist())
                due_s += 1.0 / rate_hz
                time.sleep(max(0.0, due_s - time.monotonic()))
            recorded = recorder.end()
    recorded[0] -= begun_s
    recorded[1] -= start[JOINT]
    return recorded


def lag_s(recorded: np.ndarray, duration_s: float) -> float:
    """Return the delay of the policy's path that fits the commands best, s."""
    time_s, position = recorded[:2]
    lags_s = np.arange(0.0, 0.3, 0.001)
    return float(
        lags_s[np.argmin([np.sum((position - path(time_s - lag, duration_s)) ** 2) for lag in lags_s])]
    )


def draw(recordings: dict[str, np.ndarray], rate_hz: int, duration_s: float, output: Path) -> None:
    figure = Figure(figsize=(13, 5), layout="tight")
    axes = figure.subplots(2, len(recordings), sharex=True, sharey="row")
    wanted_s = np.arange(0.0, duration_s, 0.001)
    wanted = path(wanted_s, duration_s)
    for (way, recorded), (top, bottom) in zip(recordings.items(), axes.T, strict=True):
        time_s, _, velocity, acceleration = recorded
        jerk = np.diff(acceleration) / np.diff(time_s)
        rms = np.sqrt(np.mean(jerk**2))
        legend = f"lag {1e3 * lag_s(recorded, duration_s):.0f} ms, RMS jerk {rms:.1f} rad/s³"
        for axis, rate, order in ((top, velocity, 1), (bottom, acceleration, 2)):
            axis.plot(time_s, rate, linewidth=0.9, label=legend)
            slope = wanted
            for _ in range(order):
                slope = np.gradient(slope, wanted_s)
            axis.plot(wanted_s, slope, color="0.6", linewidth=0.7, label="the policy's path")
            axis.grid(alpha=0.3)
        top.set_title(way)
        top.legend(loc="upper center", bbox_to_anchor=(0.5, -0.02), fontsize=8, frameon=False)
        bottom.set_xlabel("s")
    axes[0, 0].set_ylabel("velocity, rad/s")
    axes[1, 0].set_ylabel("acceleration, rad/s²")
    figure.suptitle(f"What rtloop commands joint {JOINT + 1}, of a policy at {rate_hz} Hz")
    figure.savefig(output, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robot", default=os.environ.get("COBOT_ROBOT", "iiwa"), help="name of the robot")
    parser.add_argument("--rate", type=int, default=30, help="rate of the policy, Hz")
    parser.add_argument("--seconds", type=float, default=4.0, help="duration of each of the four sessions, s")
    parser.add_argument("--output", type=Path, default=Path("streaming.png"))
    arguments = parser.parse_args()
    recordings = {way: follow(arguments.robot, way, arguments.rate, arguments.seconds) for way in WAYS}
    draw(recordings, arguments.rate, arguments.seconds, arguments.output)
    print("drawn:", arguments.output)


if __name__ == "__main__":
    main()
