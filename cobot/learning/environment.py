"""The arm as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces

from cobot.cell import cell_file
from cobot.client import Client, Robot
from cobot.client.states import GripperReading
from cobot.clock import SYSTEM, Clock
from cobot.config import load_settings
from cobot.errors import CollisionError, ExecutionError, InputError, MotionStopped, NotReadyError
from cobot.ipc.layout import GripperObject
from cobot.learning.arms import EpisodeArm, ServedArm, SimulatedArm
from cobot.learning.cameras import FRONT, Camera, Renderer
from cobot.learning.tasks import Reach, Task
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.limits import check_positions
from cobot.strict import unknown_key
from cobot.types import Array, vector

Observation = dict[str, Any]
MARGIN_RAD = 0.02
"""Distance that targets keep from the joints' limits, rad."""
TRIES = 100
GRIPPER_NUMBERS = ("gripper_width", "gripper_commanded_width", "gripper_force")
REACH_M = 3.0
"""Largest coordinate of a TCP in the base frame, m."""
RELATIVE, ABSOLUTE = "relative", "absolute"
Connect = Callable[[str], tuple[Client, Robot, Clock]]


class ArmEnv(gymnasium.Env[Observation, Array]):
    """One arm that follows streamed joint targets.

    Without `url`, the arm is in a separate simulation, which gives the same results for the same seed and the
    same actions, and runs as fast as possible. With `url`, it is the arm of that service, simulated or real,
    in the service's time.

    An action contains one number for each joint. With `relative` control, this is the change from the last
    target, from −1 to 1, in units of `max_velocity_rad_s` times the period. With `absolute` control, it is an
    angle, rad. For a robot with a gripper, one more number is the width between the fingers: from −1 (closed)
    to 1 (open), or with `absolute` control in m.

    Observations contain position (rad), velocity (rad/s), effort and external_effort (N·m), shape (dof,)
    each; tcp_pose (m, and a quaternion w, x, y, z); the observations of the task; and `camera_NAME` for each
    camera. With a gripper, they also contain gripper_width and gripper_commanded_width (m), gripper_force
    (N), shape (1,) each, and gripper_object, the number of a `cobot.ipc.layout.GripperObject`.

    `info` contains time_s of the robot, interventions since the last step by kind (docs/streaming.md), and
    `reason` if the session has ended, which truncates the episode.

    Args:
        config: the robot's settings file; by default the shipped one.
        cell: a cell file, or a folder with a cell.yaml, to simulate instead of `robot.cell` of the settings.
        url: URL of a running service.
        control: meaning of an action: relative or absolute.
        rate_hz: rate of the actions, 1 to 500.
        task: the task; by default `Reach`.
        cameras: cameras whose pictures are part of the observations.
        spread_rad: maximum distance of each joint from the start position at a start.
        max_velocity_rad_s: velocity of a relative action of 1.
        speed: speed of the motion to the start, with a service.
        render_mode: None, or rgb_array for the picture of the first camera, or of `cameras.FRONT` without
            cameras.
        connect: creates the REST client, the streaming client and their clock from the URL.

    Raises (constructor): InputError, ConfigError, UnavailableError: an argument is invalid or cannot be used;
    the message gives the valid values.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 30}  # noqa: RUF012 - Gymnasium's own form

    # The many parameters are those that `gymnasium.make` accepts by name.
    def __init__(
        self,
        *,
        config: Path | str | None = None,
        cell: Path | str | None = None,
        url: str | None = None,
        control: Literal["relative", "absolute"] = "relative",
        rate_hz: float = 30.0,
        task: Task | None = None,
        cameras: Sequence[Camera] = (),
        spread_rad: float = 0.2,
        max_velocity_rad_s: float = 1.0,
        speed: float = 0.2,
        render_mode: str | None = None,
        connect: Connect | None = None,
    ) -> None:
        _check_numbers(rate_hz, spread_rad, max_velocity_rad_s, speed)
        _check(control, render_mode, task, cameras)
        if not isinstance(config, Path | str | None):
            raise InputError(f"config must be the path of a settings file, got {config!r}")
        if not isinstance(cell, Path | str | None) or (cell is not None and url is not None):
            raise InputError(
                f"cell must be the path of a cell file, and cannot be combined with url: a service has the "
                f"cell of its own settings; got {cell!r}"
            )
        settings = load_settings(config if config is None else Path(config))
        if cell is not None:
            robot = settings.robot.model_copy(update={"cell": cell_file(Path(cell).resolve())})
            settings = settings.model_copy(update={"robot": robot})
        self.robot: RobotDescription = load_robot(settings)
        self._home = np.array(self.robot.positions[settings.robot.start_position].joints)
        self.render_mode = render_mode
        self._task, self._spread_rad = Reach() if task is None else task, spread_rad
        self._relative, self._period_s = control == RELATIVE, 1.0 / rate_hz
        self._step_rad = max_velocity_rad_s * self._period_s
        self._cameras = tuple(cameras)
        self._renderer = Renderer(self.robot, self._cameras) if self._cameras else None
        self._viewer: Renderer | None = None
        self._arm = (
            SimulatedArm(settings, self.robot, rate_hz)
            if url is None
            else _served(url, rate_hz, speed, connect)
        )
        limits = self.robot.limits
        self._low, self._high = limits.min_position + MARGIN_RAD, limits.max_position - MARGIN_RAD
        widths = self._arm.width_m or ()
        self.action_space = (
            spaces.Box(-1.0, 1.0, (limits.dof + bool(widths),), np.float64)
            if self._relative
            else spaces.Box(
                np.append(self._low, widths[:1]), np.append(self._high, widths[1:]), dtype=np.float64
            )
        )
        self.observation_space = self._space()
        self._target = self._home
        self._due_s = 0.0
        self._counted: dict[str, int] = {}
        self._ended = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode.

        Args:
            options: may contain `start`: joint angles at which the episode begins, rad, instead of those that
                the seed gives.

        Raises:
            InputError: there is any other option, or `start` is invalid; LimitError if it is outside the
                range of targets.
            CollisionError: the arm is in collision at `start`.
        """
        wanted = self._read_start(options)
        super().reset(seed=seed)
        start = self._draw_free_start() if wanted is None else wanted
        self._task.reset(self.robot, start, self.np_random)
        self._arm.restart(start)
        self._target, self._ended = start, False
        self._due_s = self._arm.clock.now_s()
        self._counted = self._arm.robot.interventions()
        return self._observe(), self._info("")

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Send the target, wait for one period, and observe.

        Raises:
            InputError: the action has the wrong number of joints, or a value is not a number.
            DeviceError: the gripper rejects its command.
            ExecutionError: there is no episode; call `reset` first.
        """
        if self._ended:
            raise ExecutionError("there is no running episode: reset the environment first")
        given = vector(action, self.action_space.shape[0], name="an action")
        joints, fingers = np.split(given, [len(self._target)])
        aim = self._target + self._step_rad * joints.clip(-1.0, 1.0) if self._relative else joints
        self._target = aim.clip(self._low, self._high)
        reason = refused = ""
        try:
            refused = self._send_target()
            if fingers.size:
                self._arm.aim(self._width(float(fingers[0])))
            self._due_s += self._period_s
            now_s = self._arm.clock.now_s()
            if self._due_s > now_s:
                self._arm.clock.sleep(self._due_s - now_s)
            else:
                self._due_s = now_s  # a delay is not made up for
        except (MotionStopped, NotReadyError) as exc:
            reason = str(exc)
        observation = self._observe()
        reward, reached = self._task.judge(observation)
        self._ended = bool(reason)
        return observation, reward, reached, bool(reason), self._info(reason, refused)

    def render(self) -> np.ndarray | None:
        """The current picture of a camera, uint8, shape (height, width, 3); None if there is no render
        mode.
        """
        if self.render_mode is None:
            return None
        if self._viewer is None:
            self._viewer = Renderer(self.robot, self._cameras[:1] or (FRONT,))
        (picture,) = self._viewer.render(np.array(self._arm.control.get_state().q)).values()
        return picture

    def close(self) -> None:
        """Stop the arm and release it for other clients."""
        self._ended = True
        self._arm.close()

    def _read_start(self, options: dict[str, Any] | None) -> Array | None:
        """The joint positions at which an episode begins, from the options; None if the options do not
        contain them.
        """
        if not isinstance(options, Mapping | None):
            raise InputError(f"options must be a dictionary, got {options!r}")
        given = dict(options or {})
        wanted = given.pop("start", None)
        if given:
            raise InputError(f"options: {unknown_key(str(next(iter(given))), ['start'])}")
        if wanted is None:
            return None
        what = "options: start"
        start = vector(wanted, len(self._home), name=what)
        possible = replace(self.robot.limits, min_position=self._low, max_position=self._high)
        check_positions(possible, start, f"{what}: angle")
        self.robot.collision.check_position(start, what)
        return start

    def _draw_free_start(self) -> Array:
        for _ in range(TRIES):
            away = self.np_random.uniform(-self._spread_rad, self._spread_rad, len(self._home))
            free: Array = (self._home + away).clip(self._low, self._high)
            try:
                self.robot.collision.check_position(free, "a start")
            except CollisionError:
                continue
            return free
        return self._home

    def _observe(self) -> Observation:
        state = self._arm.robot.states()
        seen: Observation = {
            "position": np.array(state.q),
            "velocity": np.array(state.dq),
            "effort": np.array(state.tau),
            "external_effort": np.array(state.tau_ext),
            "tcp_pose": np.array(state.tcp_pose),
            **self._task.observe(),
        }
        if self._arm.width_m is not None:
            seen |= _gripper(state.gripper)
        for name, space in self.observation_space.items():
            if name in seen and isinstance(space, spaces.Box):
                seen[name] = seen[name].clip(space.low, space.high)
        if self._renderer is not None:
            for name, picture in self._renderer.render(seen["position"]).items():
                seen[f"camera_{name}"] = picture
        return seen

    def _width(self, number: float) -> float:
        """Convert the last number of an action to a width, m."""
        if not self._relative or self._arm.width_m is None:
            return number
        low, high = self._arm.width_m
        return low + 0.5 * (number + 1.0) * (high - low)

    def _send_target(self) -> str:
        """Send the target. Returns the reason why the arm does not follow the first target of an episode; ""
        if the arm follows it.
        """
        try:
            self._arm.control.set_target_joints(self._target.tolist())
        except InputError as exc:
            return str(exc)
        return ""

    def _info(self, reason: str, refused: str = "") -> dict[str, Any]:
        before, self._counted = self._counted, self._arm.robot.interventions()
        new = {kind: count - before[kind] for kind, count in self._counted.items() if count > before[kind]}
        info: dict[str, Any] = {"time_s": self._arm.robot.clock_s(), "interventions": new}
        sentences = {"reason": reason, "refused": refused}
        return {**info, **{name: sentence for name, sentence in sentences.items() if sentence}}

    def _space(self) -> spaces.Dict:
        limits = self.robot.limits
        beyond = 0.5  # rad; if it is pushed, an arm that yields may be beyond its limits
        boxes = {
            "position": (limits.min_position - beyond, limits.max_position + beyond),
            "velocity": (-2.0 * limits.max_velocity, 2.0 * limits.max_velocity),
            "effort": (-2.0 * limits.max_effort, 2.0 * limits.max_effort),
            "external_effort": (-2.0 * limits.max_effort, 2.0 * limits.max_effort),
            "tcp_pose": (np.array([-REACH_M] * 3 + [-1.0] * 4), np.array([REACH_M] * 3 + [1.0] * 4)),
        }
        found: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(low, high, dtype=np.float64) for name, (low, high) in boxes.items()
        }
        if self._arm.width_m is not None:
            width_m, force_n = 1.5 * self._arm.width_m[1], 2.0 * self._arm.max_force_n
            for name, high in zip(GRIPPER_NUMBERS, (width_m, width_m, force_n), strict=True):
                found[name] = spaces.Box(0.0, high, (1,), np.float64)
            found["gripper_object"] = spaces.Discrete(len(GripperObject))
        found |= self._task.spaces()
        for camera in self._cameras:
            shape = (camera.height, camera.width, 3)
            found[f"camera_{camera.name}"] = spaces.Box(0, 255, shape, np.uint8)
        return spaces.Dict(found)


def _check_numbers(rate_hz: float, spread_rad: float, velocity: float, speed: float) -> None:
    given: dict[str, object] = {
        "rate_hz": rate_hz,
        "spread_rad": spread_rad,
        "max_velocity_rad_s": velocity,
        "speed": speed,
    }
    for name, value in given.items():
        if not isinstance(value, Real):
            raise InputError(f"{name} must be a number, got {value!r}")
    if not 1.0 <= rate_hz <= 500.0:
        raise InputError(f"rate_hz must be from 1 to 500, got {rate_hz}")
    if not 0.0 <= spread_rad <= 3.0:
        raise InputError(f"spread_rad must be from 0 to 3 rad, got {spread_rad}")
    if not 0.0 < velocity <= 10.0:
        raise InputError(f"max_velocity_rad_s must be above 0 and at most 10 rad/s, got {velocity}")


def _check(control: str, render_mode: str | None, task: Task | None, cameras: Sequence[Camera]) -> None:
    if control not in (RELATIVE, ABSOLUTE):
        raise InputError(f"control must be {RELATIVE} or {ABSOLUTE}, got {control!r}")
    if render_mode not in (None, "rgb_array"):
        raise InputError(f"render_mode must be None or rgb_array, got {render_mode!r}")
    for method in ("spaces", "reset", "observe", "judge"):
        if task is not None and not callable(getattr(task, method, None)):
            raise InputError(f"task must be a learning.tasks.Task; {task!r} has no method {method}")
    if not isinstance(cameras, Sequence) or not all(isinstance(each, Camera) for each in cameras):
        raise InputError(f"cameras must be a list of learning.cameras.Camera, got {cameras!r}")


def _gripper(reading: GripperReading | None) -> Observation:
    """The gripper's part of an observation. `reading` is None before the gripper has been read."""
    if reading is None:
        return {**{name: np.zeros(1) for name in GRIPPER_NUMBERS}, "gripper_object": np.int64(0)}
    numbers = (reading.known_width, reading.target_width, reading.known_force)
    return {
        **{name: np.array([number]) for name, number in zip(GRIPPER_NUMBERS, numbers, strict=True)},
        "gripper_object": np.int64(reading.object),
    }


def _served(url: str, rate_hz: float, speed: float, connect: Connect | None) -> EpisodeArm:
    client, robot, clock = connect(url) if connect else (Client(url), Robot(url), SYSTEM)
    return ServedArm(robot, client, rate_hz, speed, clock)
