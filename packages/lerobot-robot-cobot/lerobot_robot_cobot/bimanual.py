"""Two arms served by cobot as one LeRobot robot. As in LeRobot's own two-armed robots, the names of an arm's
observations and actions begin with `left_` or `right_`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from functools import cached_property
from typing import Any, ClassVar

from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.utils.errors import DeviceAlreadyConnectedError

from cobot.client import Robot
from lerobot_robot_cobot.columns import targets
from lerobot_robot_cobot.config_cobot import BiCobotRobotConfig, CobotArmConfig, CobotRobotConfig
from lerobot_robot_cobot.pictures import latest_pictures, picture_shapes
from lerobot_robot_cobot.robot import CalibratedRobot, CobotRobot

LEFT, RIGHT = "left_", "right_"


class BiCobotRobot(CalibratedRobot):
    """Two arms of running services. When one arm fails, the other one is stopped too.

    Args:
        connect: function that makes the streaming client of an arm from the URL and the token.
    """

    config_class: ClassVar[type[BiCobotRobotConfig]] = BiCobotRobotConfig
    name: ClassVar[str] = "bi_cobot"

    def __init__(
        self, config: BiCobotRobotConfig, connect: Callable[[str, str | None], Robot] | None = None
    ) -> None:
        super().__init__(config)
        self.config = config
        self._arms = {
            prefix: CobotRobot(_arm_config(config, prefix, arm), connect)
            for prefix, arm in ((LEFT, config.left_arm_config), (RIGHT, config.right_arm_config))
        }
        self._cameras: dict[str, Any] = make_cameras_from_configs(config.cameras)
        self.cameras = self._cameras | {
            f"{prefix}{name}": camera
            for prefix, arm in self._arms.items()
            for name, camera in arm.cameras.items()
        }
        if len(self.cameras) < len(self._cameras) + sum(len(arm.cameras) for arm in self._arms.values()):
            raise ValueError(f"two cameras have the same name: {', '.join(sorted(self.cameras))}")

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        of_arms = self._both(lambda arm: arm.observation_features)
        return {**of_arms, **picture_shapes(self.config.cameras)}

    @cached_property
    def action_features(self) -> dict[str, type]:
        return self._both(lambda arm: arm.action_features)

    @property
    def is_connected(self) -> bool:
        parts = (*self._arms.values(), *self._cameras.values())
        return all(part.is_connected for part in parts)

    def connect(self, calibrate: bool = True) -> None:
        """Begin a session with both arms, and open the cameras. If one of them fails, none stays connected.

        Raises:
            DeviceAlreadyConnectedError: the robot is already connected.
            DeviceNotConnectedError: a service or rtloop rejects the session; the error has the reason.
        """
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        try:
            for part in (*self._arms.values(), *self._cameras.values()):
                part.connect()
        except BaseException:
            self.disconnect()
            raise

    def get_observation(self) -> dict[str, Any]:
        """Return the observations of both arms, and a picture from each camera.

        Raises:
            DeviceNotConnectedError: an arm is not connected or does not answer. Both arms are then stopped.
        """
        with self._together():
            return self._both(lambda arm: arm.get_observation()) | latest_pictures(self._cameras)

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Set the targets of both arms. Returns the targets.

        Raises:
            ValueError: a target is missing or not a number. No arm has then received a target.
            DeviceNotConnectedError: a session has ended; the error has the reason. Both arms are then
                stopped.
        """
        target = targets(action, self.action_features)
        with self._together():
            for prefix, arm in self._arms.items():
                arm.send_action({name: target[f"{prefix}{name}"] for name in arm.action_features})
        return target

    def disconnect(self) -> None:
        """Stop both arms and release them for other clients. May be called again."""
        with ExitStack() as parts:  # disconnect each part even if another one fails
            for camera in self._cameras.values():
                if camera.is_connected:
                    parts.callback(camera.disconnect)
            for arm in self._arms.values():
                parts.callback(arm.disconnect)

    def _both(self, read: Callable[[CobotRobot], dict[str, Any]]) -> dict[str, Any]:
        return {
            f"{prefix}{name}": value
            for prefix, arm in self._arms.items()
            for name, value in read(arm).items()
        }

    @contextmanager
    def _together(self) -> Iterator[None]:
        """If an arm or a camera fails in the context, stop both arms, even if the program continues."""
        try:
            yield
        except BaseException:
            self.disconnect()
            raise


def _arm_config(config: BiCobotRobotConfig, prefix: str, arm: CobotArmConfig) -> CobotRobotConfig:
    values = {each.name: getattr(arm, each.name) for each in fields(CobotArmConfig)}
    name = f"{config.id}_{prefix.rstrip('_')}" if config.id else None
    return CobotRobotConfig(id=name, calibration_dir=config.calibration_dir, **values)
