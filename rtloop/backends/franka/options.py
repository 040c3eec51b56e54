"""Options of `type: franka` in `robot.backend`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from rtloop.backends.protocols import BackendOptions

DOF = 7
Torque = Annotated[float, Field(gt=0.0, le=100.0)]
Force = Annotated[float, Field(gt=0.0, le=200.0)]
Stiffness = Annotated[float, Field(ge=10.0, le=14250.0)]
Seven = Annotated[list[Torque], Field(min_length=DOF, max_length=DOF)]


class FrankaOptions(BackendOptions):
    """Options of a Franka.

    Attributes:
        address: address of the robot's control unit, an IP address or a name.
        realtime: "enforce" rejects computers without a real-time kernel, which Franka Robotics requires;
            "ignore" accepts them, for simulations and first steps.
        contact_torque, contact_force: thresholds above which the robot reports contact, N·m for each joint,
            and N, N·m along each axis.
        collision_torque, collision_force: thresholds above which a reflex stops the robot.
        check_pose: whether to check that the robot reports the model's pose.
        joint_stiffness: stiffness of the robot's own position controller, N·m/rad; None for the robot's
            default.
    """

    model_config = ConfigDict(allow_inf_nan=False)

    address: Annotated[str, Field(min_length=1, max_length=253)]
    realtime: Literal["enforce", "ignore"] = "enforce"
    contact_torque: Seven = Field([20.0, 20.0, 18.0, 18.0, 10.0, 9.0, 8.0])
    collision_torque: Seven = Field([40.0, 40.0, 36.0, 36.0, 12.0, 12.0, 12.0])
    contact_force: Annotated[list[Force], Field(min_length=6, max_length=6)] = [20.0] * 3 + [15.0] * 3
    collision_force: Annotated[list[Force], Field(min_length=6, max_length=6)] = [40.0] * 3 + [30.0] * 3
    check_pose: bool = True
    joint_stiffness: Annotated[list[Stiffness], Field(min_length=DOF, max_length=DOF)] | None = None
