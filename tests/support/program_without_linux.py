"""A program of the client's as it would run on Windows: without what only Linux has.

    python program_without_linux.py URL

It reads, moves, streams and stops, and prints what came of it as JSON.
"""

from __future__ import annotations

import asyncio  # noqa: F401
import json
import os
import pkgutil
import sys
import time
from importlib import import_module
from typing import Any

# These have code of their own for each operating system: they are imported as what this one is.
import httpx2  # noqa: F401
import numpy as np
import websockets.sync.client  # noqa: F401

WAIT_S = 30.0
ONLY_HERE = ["fcntl", "resource", "termios", "pwd", "grp", "mujoco", "ompl", "ruckig", "scipy", "rtloop"]
GONE = [(os, name) for name in ("fork", "getuid", "pread", "posix_fallocate", "sched_getaffinity")]
GONE += [(time, name) for name in ("clock_gettime", "clock_nanosleep", "CLOCK_MONOTONIC")]


def refuse(event: str, arguments: tuple[Any, ...]) -> None:
    """An audit hook: no shared memory, and no library but those that are loaded already."""
    if event == "ctypes.dlopen" or (event == "open" and str(arguments[0]).startswith("/dev/shm")):
        raise OSError(f"{event} {arguments}: there is no such thing elsewhere")


def be_elsewhere() -> None:
    for name in ONLY_HERE:
        sys.modules[name] = None  # type: ignore[assignment]
    for module, name in GONE:
        if hasattr(module, name):
            delattr(module, name)
    sys.addaudithook(refuse)
    sys.platform = "win32"


def main(url: str) -> dict[str, Any]:
    be_elsewhere()
    import cobot
    from cobot import Mode, Robot
    from cobot.client import Client
    from cobot.errors import MotionStopped, NotSupportedError

    modules = [each.name for each in pkgutil.walk_packages(cobot.__path__, "cobot.")]
    for name in modules:
        import_module(name)
    said: dict[str, Any] = {"modules": modules}
    try:
        Robot("iiwa", connect_retries=0)
    except NotSupportedError as error:
        said["by name"] = str(error)
    with Client(url) as client:
        home = client.joint_states()["position"]
        away = [home[0] + 0.2, *home[1:]]
        said["moved"] = client.move_joints(away, speed=1.0)["success"]
    with Robot(url) as robot:
        states = robot.states()
        said["flange"] = float(np.linalg.norm(states.flange_pose[3:]))
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        with robot.start_joint_impedance_control(100, interpolation="quintic") as control:
            begin = control.get_state().q
            for tick in range(50):
                control.set_target_joints([begin[0] - 0.1 * tick / 50, *begin[1:]])
                time.sleep(0.01)
            deadline_s = time.monotonic() + WAIT_S  # A busy computer sends late, and the arm comes later.
            while control.get_state().q[0] > begin[0] - 0.09 and time.monotonic() < deadline_s:
                control.set_target_joints([begin[0] - 0.1, *begin[1:]])
                time.sleep(0.01)
            said["streamed"] = control.get_state().q[0] - begin[0]
            robot.stop()
            try:
                control.set_target_joints(begin)
            except MotionStopped:
                said["stopped"] = True
        robot.switch_mode(Mode.NRT_PRIMITIVE_EXECUTION)
        robot.execute_primitive("MoveL", {"target": robot.states().tcp_pose, "speed": 1.0})
        while robot.busy():
            time.sleep(0.01)
        said["rests"] = robot.stopped()
    return said


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])))
