"""Records an episode while something else moves the arm: a person with a gamepad, a policy or a program."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cobot.client import Robot
from cobot.clock import SYSTEM, Clock
from cobot.errors import InputError
from cobot.learning.cameras import Renderer
from cobot.learning.episodes import EpisodeWriter

MAX_EPISODE_S = 3600.0


# There are many parameters because this is a public function. Callers name most of them or use the default.
def record(
    robot: Robot,
    joint_names: list[str],
    path: Path,
    *,
    seconds: float,
    rate_hz: float = 30.0,
    task: str = "",
    renderer: Renderer | None = None,
    ended: Callable[[], bool] = lambda: False,
    clock: Clock = SYSTEM,
) -> int:
    """Write the arm's states and commands to a file, until the time has elapsed or `ended` returns True.

    The action of a frame is the joint position that the real-time loop commanded at the time of the frame.
    With a gripper, the commanded width is also recorded, in the gripper topic.

    Returns:
        The number of frames.

    Raises:
        InputError: the duration or the rate is outside its limits.
        UnavailableError: the robot does not answer. No file is kept.
    """
    if not 0.0 < seconds <= MAX_EPISODE_S or not 1.0 <= rate_hz <= 200.0:
        raise InputError(
            f"an episode lasts up to {MAX_EPISODE_S:g} s at 1 to 200 Hz, got {seconds} s at {rate_hz} Hz"
        )
    name = robot.info().serial_num
    with EpisodeWriter(path, joint_names, rate_hz, task=task, robot=name) as episode:
        begun_s = clock.now_s()
        epoch_s = time.time() - begun_s
        for frame in range(round(seconds * rate_hz)):
            if ended():
                break
            state = robot.states()
            pictures = renderer.render(np.array(state.q)) if renderer else {}
            commanded, now_s = robot.commanded_position(), epoch_s + clock.now_s()
            episode.add(now_s, state.q, state.dq, commanded, pictures, state.gripper)
            clock.sleep(max(0.0, begun_s + (frame + 1) / rate_hz - clock.now_s()))
        return episode.frames
