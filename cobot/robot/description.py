"""A robot as the settings describe it: model, limits, named positions, collision checker."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cobot.config import Settings, naming
from cobot.errors import ConfigError
from cobot.robot.collision import CollisionChecker
from cobot.robot.drives import check_drives, check_forces, check_passive_forces, check_ranges
from cobot.robot.file_limits import check_velocities
from cobot.robot.limits import check_positions, load_joint_limits
from cobot.robot.model import RobotModel
from cobot.robot.srdf import disabled_pairs, load_named_positions
from cobot.types import CartesianLimits, JointLimits, NamedPosition, vector


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """Everything that planning needs. Not thread safe, because all calls use one scratch memory.

    Attributes:
        model_file: the model file, whose folder contains the visuals of the links; None if the model was made
            in memory.
    """

    name: str
    base_frame: str
    model: RobotModel
    collision: CollisionChecker
    limits: JointLimits
    cartesian_limits: CartesianLimits
    positions: dict[str, NamedPosition]
    model_file: Path | None = None

    def rename(self, positions: dict[str, NamedPosition]) -> None:
        """Replace the named positions, for all users of this description."""
        self.positions.clear()
        self.positions.update(positions)

    def check_named_positions(self, source: Path) -> None:
        """Reject a robot with a named position beyond its limits or in collision.

        Args:
            source: the file with the positions, for the message.

        Raises:
            LimitError, CollisionError: names the file, the position, and the joint or the bodies.
        """
        for position in self.positions.values():
            what, joints = f"{source}: position {position.name!r}", vector(position.joints)
            check_positions(self.limits, joints, f"{what}: the angle")
            self.collision.check_position(joints, what)


def load_robot(settings: Settings) -> RobotDescription:
    """Read the model, limits and named positions that the settings refer to.

    Raises:
        ConfigError: a file is missing or invalid, the files do not match each other, or the simulation cannot
            drive the model's actuators because they do not accept torques.
    """
    with naming("web.joint_limits"):
        limits = load_joint_limits(settings.web.joint_limits)
    with naming("robot.model"):
        model = RobotModel.load(
            settings.robot.model, limits, base=settings.robot.base_frame, tcp=settings.robot.tcp
        )
        limits = model.limits
        if settings.robot.backend.type == "mujoco":
            check_drives(model.mj, limits)
            check_passive_forces(model.mj)
    with naming("web.joint_limits"):
        check_ranges(model.mj, limits)
        check_velocities(settings.robot.model, model.mj, limits)
        if settings.robot.backend.type == "mujoco":
            check_forces(model.mj, limits)
    with naming("robot.srdf"):
        positions = load_named_positions(settings.robot.srdf, limits.names, settings.robot.group)
        disabled = disabled_pairs(settings.robot.srdf)
    if settings.robot.start_position not in positions:
        raise ConfigError(
            f"robot.start_position: {settings.robot.start_position!r} is not in {settings.robot.srdf}; "
            f"valid names: {', '.join(positions)}"
        )
    planning = settings.planning
    if planning.default_frame != settings.robot.base_frame:
        raise ConfigError(
            f"planning.default_frame: there is no frame {planning.default_frame!r}; "
            f"valid names: {settings.robot.base_frame}"
        )
    cartesian = CartesianLimits(
        planning.max_linear_velocity,
        planning.max_linear_acceleration,
        planning.max_linear_jerk,
        planning.max_angular_velocity,
        planning.max_angular_acceleration,
        planning.max_angular_jerk,
    )
    return RobotDescription(
        name=settings.robot.name,
        base_frame=settings.robot.base_frame,
        model=model,
        collision=CollisionChecker(model, settings.planning.collision_margin_m, disabled),
        limits=limits,
        cartesian_limits=cartesian,
        positions=positions,
        model_file=settings.robot.model,
    )
