"""A robot for LeRobot. Observations are joint angles and pictures, actions are target joint angles, rad. With
a gripper, both include its width, m.

Actions are sent through cobot's streaming interface (docs/streaming.md of cobot). Whatever the actions are,
the arm moves smoothly, stays within its limits and avoids the obstacles in the service's scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, ClassVar

from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.robots import Robot as LeRobot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from cobot.client import JointImpedanceControl, Mode, Robot, ServedFingers
from cobot.errors import CobotError
from lerobot_robot_cobot.columns import OBSERVED, SUFFIX, WIDTH, observed, targets
from lerobot_robot_cobot.config_cobot import CobotRobotConfig
from lerobot_robot_cobot.pictures import latest_pictures, picture_shapes


class CalibratedRobot(LeRobot):  # type: ignore[misc, unused-ignore]
    """A robot that LeRobot need neither calibrate nor configure."""

    @property
    def is_calibrated(self) -> bool:
        """Always true: the arms' controllers know their joint positions."""
        return True

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...


class CobotRobot(CalibratedRobot):
    """One arm of a running service.

    Args:
        connect: function that makes the streaming client from the URL and the token.
    """

    config_class: ClassVar[type[CobotRobotConfig]] = CobotRobotConfig
    name: ClassVar[str] = "cobot"

    def __init__(
        self, config: CobotRobotConfig, connect: Callable[[str, str | None], Robot] | None = None
    ) -> None:
        super().__init__(config)
        self.config = config
        self.cameras: dict[str, Any] = make_cameras_from_configs(config.cameras)
        self._connect = connect or (lambda url, token: Robot(url, token=token))
        self._robot: Robot | None = None
        self._control: JointImpedanceControl | None = None
        self._fingers: ServedFingers | None = None

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        gripper = dict.fromkeys(OBSERVED, float) if self.config.gripper else {}
        return {**dict.fromkeys(self._joints, float), **gripper, **picture_shapes(self.config.cameras)}

    @cached_property
    def action_features(self) -> dict[str, type]:
        return dict.fromkeys([*self._joints, WIDTH] if self.config.gripper else self._joints, float)

    @cached_property
    def _joints(self) -> list[str]:
        return [f"{joint}{SUFFIX}" for joint in self.config.joints]

    @property
    def is_connected(self) -> bool:
        if self._control is None or not self._control.is_running():
            return False
        return all(camera.is_connected for camera in self.cameras.values())

    def connect(self, calibrate: bool = True) -> None:
        """Begin a session with the arm, and open the cameras.

        Raises:
            DeviceAlreadyConnectedError: the robot is already connected.
            DeviceNotConnectedError: the service or rtloop rejects the session; the error has the reason.
        """
        if self._robot is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        with self._in_words():
            self._robot = self._connect(self.config.url, self.config.token)
            try:
                self._begin(self._robot)
                for camera in self.cameras.values():
                    camera.connect()
            except BaseException:
                self.disconnect()
                raise

    def _begin(self, robot: Robot) -> None:
        dof = robot.info().DoF
        if dof != len(self.config.joints):
            raise DeviceNotConnectedError(
                f"robot.joints names {len(self.config.joints)} joints, but the robot of "
                f"{self.config.url} has {dof}"
            )
        if self.config.gripper:
            self._fingers = ServedFingers.of(robot.gripper)
            if self._fingers is None:
                raise DeviceNotConnectedError(
                    f"robot.gripper is true, but the robot of {self.config.url} has no gripper"
                )
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        self._control = robot.start_joint_impedance_control(
            self.config.rate_hz, interpolation=self.config.interpolation
        )

    def get_observation(self) -> dict[str, Any]:
        """Return the joint angles, rad, the gripper's values, and a picture from each camera.

        Raises:
            DeviceNotConnectedError: the robot is not connected, or the arm does not answer.
        """
        with self._in_words():
            state = self._session().get_state()
        seen: dict[str, Any] = dict(zip(self._joints, state.q, strict=True))
        if self.config.gripper:
            if state.gripper is None:
                raise DeviceNotConnectedError(
                    f"{self.config.url}: the gripper has not been read yet; GET /robot/gripper has the reason"
                )
            seen |= observed(state.gripper)
        return seen | latest_pictures(self.cameras)

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Set the targets of the joints and the gripper. Returns the targets.

        Raises:
            ValueError: a joint is missing or not a number.
            DeviceNotConnectedError: the session has ended; the error has the reason.
        """
        target = targets(action, self.action_features)
        with self._in_words():
            self._session().set_target_joints([target[name] for name in self._joints])
            if self._fingers is not None:
                self._fingers.aim(target[WIDTH])
        return target

    def disconnect(self) -> None:
        """Stop the arm and release it for other clients. May be called again."""
        robot, self._robot, self._control, self._fingers = self._robot, None, None, None
        if robot is not None:
            robot.close()
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()

    def _session(self) -> JointImpedanceControl:
        if self._control is None:
            raise DeviceNotConnectedError(f"{self} is not connected: call connect() first")
        return self._control

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        try:
            yield
        except CobotError as exc:
            raise DeviceNotConnectedError(f"{self.config.url}: {exc}") from exc
