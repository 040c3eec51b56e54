"""Actions and conditions of motions in answers, as JSON."""

from __future__ import annotations

from pydantic import BaseModel, Field

from cobot.motions.fields import example


class ActionAnswer(BaseModel):
    """An action on the path, and its result."""

    action: str = Field(description="The field of the action in the request.")
    does: str = Field(description="The action in words.")
    at: str = Field(description="The requested place on the path.")
    planned_s: float = Field(description="The path time of that place, s.")
    fired: bool | None = Field(
        description="Whether it has fired; null if the service has not seen the end of the motion."
    )
    path_time_s: float | None = Field(description="Path time of the cycle in which it fired, s.")
    robot_time_s: float | None = Field(description="Time of that cycle on the robot's clock, s.")
    position: list[float] | None = Field(
        description="Position of the TCP in the base frame, as measured in that cycle, m."
    )
    problem: str = Field(
        description="Reason why the action had no effect; empty if it had one, or has not fired."
    )


class ContactAnswer(BaseModel):
    """The state of the arm when the condition `until` was met."""

    model_config = example(
        {
            "position": [0.55, 0.0, 0.201],
            "quaternion": [0.0, 1.0, 0.0, 0.0],
            "force": [0.1, -0.2, 21.3],
            "torque": [0.0, 0.1, 0.0],
            "value": 21.3,
            "path_time_s": 2.104,
            "robot_time_s": 1834.022,
            "overshoot_m": 0.0002,
            "retracted_m": 0.0,
        }
    )

    position: list[float] = Field(description="Position of the TCP in the base frame, m.")
    quaternion: list[float] = Field(description="Orientation of the TCP in the base frame: x, y, z, w.")
    force: list[float] = Field(
        description="Force of the surroundings on the TCP, in the base frame, relative to the zero, N."
    )
    torque: list[float] = Field(
        description="Torque of the surroundings on the TCP, in the base frame, relative to the zero, N·m."
    )
    value: float = Field(
        description="Value of the input, or magnitude of the force or torque in the condition."
    )
    path_time_s: float = Field(description="Path time of the cycle, s.")
    robot_time_s: float = Field(description="Time of the cycle on the robot's clock, s.")
    overshoot_m: float | None = Field(
        description="Distance that the TCP moved after the contact until it was at rest, m."
    )
    retracted_m: float = Field(
        description="Distance that the TCP moved back along its path after the contact, m."
    )
