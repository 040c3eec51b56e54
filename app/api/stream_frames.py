"""Text frames of the WebSocket /robot/stream: conversion between strict JSON and the records of
`cobot.ipc.layout`.
"""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from app.api.schemas.scene import Point
from app.api.state_json import state_content
from app.services.rights.lease import TIMEOUT_S, TIMEOUTS_S
from app.services.streaming.jog import JogCommand
from cobot.errors import InputError, NotReadyError
from cobot.ipc.layout import CHUNK_POINTS, Interpolation, Stream, chunk_dtype
from cobot.ipc.session_rules import MOVE_S, decimation, nominal_session
from cobot.loose_lists import RequestModel
from cobot.motions.fields import Finite
from cobot.strict import sentences, shown
from cobot.types import vector

Numbers = Annotated[list[Finite], Field(max_length=64)]
SomeNumbers = Annotated[list[Finite], Field(min_length=1, max_length=64)]
"""List of numbers for an optional field. `[]` means that the field is not set."""
Sequence = Annotated[int, Field(ge=1, lt=2**63)]
Frame = dict[str, Any]


class SubscribeFrame(RequestModel):
    type: Literal["subscribe"]
    rate_hz: float = Field(100.0, ge=1.0, le=1000.0)
    format: Literal["json", "binary"] = "json"


class SessionFrame(RequestModel):
    type: Literal["session"]
    stream: Literal["joint_impedance", "cartesian", "joint_torque"] = "joint_impedance"
    inner_control_hz: float = Field(1000.0, ge=1.0, le=1000.0)
    interpolation: Literal["none", "linear", "quintic", "ruckig"] = "linear"
    stiffness: SomeNumbers | None = None
    damping_ratio: SomeNumbers | None = None
    cartesian_stiffness: SomeNumbers | None = None
    cartesian_damping_ratio: SomeNumbers | None = None
    max_contact_torque: SomeNumbers | None = None
    max_contact_wrench: SomeNumbers | None = None
    force_axes: Annotated[list[bool], Field(min_length=1, max_length=6)] | None = None
    force_velocity: SomeNumbers | None = None
    force_frame: SomeNumbers | None = None
    force_in_tcp: bool = False
    posture: SomeNumbers | None = None

    def record(self, info: np.ndarray) -> np.ndarray:
        """Return the record of the requested session. Omitted values get their nominal values.

        Raises:
            NotReadyError: rtloop has not reported its robot yet.
        """
        if not info["period_s"]:
            raise NotReadyError("the real-time loop has not reported its robot yet: try again in a second")
        request = nominal_session(info)
        request["stream"] = Stream[self.stream.upper()]
        request["interpolation"] = Interpolation[self.interpolation.upper()]
        request["decimation"] = decimation(self.inner_control_hz, float(info["period_s"]))
        request["force_in_tcp"] = self.force_in_tcp
        for name in VECTORS:
            _set(request, name, getattr(self, name), name)
        return request


VECTORS = [name for name, field in SessionFrame.model_fields.items() if field.default is None]


class JointTargetFrame(RequestModel):
    type: Literal["target"]
    sequence: Sequence
    joints: Numbers
    velocities: SomeNumbers | None = None

    def fill(self, setpoint: np.ndarray) -> None:
        _set(setpoint, "joints", self.joints, "joints")
        _set(setpoint, "joint_velocity", self.velocities, "velocities")
        setpoint["feed_forward"] = self.velocities is not None
        setpoint["number"] = self.sequence


class PoseTargetFrame(RequestModel):
    type: Literal["target"]
    sequence: Sequence
    pose: Numbers
    wrench: Numbers = [0.0] * 6
    velocity: SomeNumbers | None = None

    def fill(self, setpoint: np.ndarray) -> None:
        _set(setpoint, "pose", self.pose, "pose")
        _set(setpoint, "wrench", self.wrench, "wrench")
        _set(setpoint, "twist", self.velocity, "velocity")
        setpoint["feed_forward"] = self.velocity is not None
        setpoint["number"] = self.sequence


class TorqueTargetFrame(RequestModel):
    type: Literal["target"]
    sequence: Sequence
    torques: Numbers

    def fill(self, setpoint: np.ndarray) -> None:
        _set(setpoint, "joints", self.torques, "torques")
        setpoint["number"] = self.sequence


TARGETS: dict[Stream, type[JointTargetFrame] | type[PoseTargetFrame] | type[TorqueTargetFrame]] = {
    Stream.JOINT_IMPEDANCE: JointTargetFrame,
    Stream.CARTESIAN: PoseTargetFrame,
    Stream.JOINT_TORQUE: TorqueTargetFrame,
}


class MoveFrame(RequestModel):
    type: Literal["move"]
    sequence: Sequence
    pose: Numbers
    duration_s: float = Field(3.0, ge=MOVE_S[0], le=MOVE_S[1])

    def fill(self, setpoint: np.ndarray) -> None:
        _set(setpoint, "move_pose", self.pose, "pose")
        setpoint["move_duration_s"] = self.duration_s
        setpoint["move"] = self.sequence


class CancelFrame(RequestModel):
    type: Literal["cancel"]
    sequence: Sequence

    def fill(self, setpoint: np.ndarray) -> None:
        setpoint["cancel"] = setpoint["move"]


class ChunkFrame(RequestModel):
    type: Literal["chunk"]
    sequence: Sequence
    times_s: Numbers
    points: Annotated[list[Numbers], Field(max_length=CHUNK_POINTS)]

    def record(self, dof: int) -> np.ndarray:
        chunk = np.zeros((), chunk_dtype(dof))
        chunk["number"], chunk["count"] = self.sequence, len(self.points)
        chunk["times_s"][: len(self.points)] = vector(self.times_s, len(self.points), name="times_s")
        for index, point in enumerate(self.points):
            chunk["points"][index, :dof] = vector(point, dof, name=f"points[{index}]")
        return chunk


class EstopFrame(RequestModel):
    type: Literal["estop"]


class EndFrame(RequestModel):
    type: Literal["end"]


class StopFrame(RequestModel):
    """Stop every robot of the service, like `POST /stop`. The answer has the number of the newest stop."""

    type: Literal["stop"]
    number: int = Field(0, ge=0, le=2**31)


class ControlFrame(RequestModel):
    type: Literal["control"]
    timeout_s: float = Field(TIMEOUT_S, ge=TIMEOUTS_S[0], le=TIMEOUTS_S[1])


class ReleaseFrame(RequestModel):
    type: Literal["release"]


class JogFrame(RequestModel):
    """The velocities of a jog. A frame without velocities ends the jog."""

    type: Literal["jog"]
    joints: SomeNumbers | None = None
    twist: Annotated[list[Finite], Field(min_length=6, max_length=6)] | None = None
    frame: Literal["base", "tool"] = "base"

    @model_validator(mode="after")
    def _one_of_both(self) -> JogFrame:
        if self.joints is not None and self.twist is not None:
            raise ValueError("joints and twist cannot be combined; give one of them")
        if self.twist is None and "frame" in self.model_fields_set:
            raise ValueError("frame: is only allowed together with twist, which is missing")
        return self

    def command(self) -> JogCommand | None:
        """The jog command; None for a release."""
        if not any(self.joints or self.twist or ()):
            return None
        joints = None if self.joints is None else np.array(self.joints)
        return JogCommand(joints, None if self.twist is None else np.array(self.twist), self.frame == "tool")


class Pull(RequestModel):
    """Pulls the simulated arm at a point of a link. A frame without a link ends the pull."""

    type: Literal["pull"]
    link: Annotated[str, Field(min_length=1, max_length=64)] | None = None
    point: Point | None = None
    target: Point | None = None

    @model_validator(mode="after")
    def _all_or_none(self) -> Pull:
        if len({value is None for value in (self.link, self.point, self.target)}) > 1:
            raise ValueError(
                "link, point and target must be given together; a frame with none of them ends the pull"
            )
        return self


TextFrame = (
    SubscribeFrame
    | SessionFrame
    | JointTargetFrame
    | PoseTargetFrame
    | TorqueTargetFrame
    | MoveFrame
    | CancelFrame
    | ChunkFrame
    | EstopFrame
    | EndFrame
    | StopFrame
    | ControlFrame
    | ReleaseFrame
    | JogFrame
    | Pull
)
MODELS: dict[str, type[TextFrame]] = {
    "subscribe": SubscribeFrame,
    "session": SessionFrame,
    "move": MoveFrame,
    "cancel": CancelFrame,
    "chunk": ChunkFrame,
    "estop": EstopFrame,
    "end": EndFrame,
    "stop": StopFrame,
    "control": ControlFrame,
    "release": ReleaseFrame,
    "jog": JogFrame,
    "pull": Pull,
}


def read_frame(content: Frame, stream: Stream) -> TextFrame:
    """Check a decoded frame.

    Args:
        stream: the session's type, which determines the keys of a target.

    Raises:
        InputError: the frame is invalid. The error lists the valid values.
    """
    kind = content.get("type")
    model = TARGETS[stream] if kind == "target" else MODELS.get(kind) if isinstance(kind, str) else None
    if model is None:
        valid = ", ".join([*MODELS, "target"])
        raise InputError(f"there is no frame of type {shown(kind)}; valid types: {valid}")
    try:
        return model.model_validate(content)
    except ValidationError as exc:
        raise InputError(sentences(exc.errors())) from exc


def state_frame(state: np.ndarray, sequence: int) -> str:
    """Return the state as JSON. Values that are not finite numbers are null."""
    content: Frame = {"type": "state", "sequence": sequence, **state_content(state)}
    try:
        return json.dumps(content, allow_nan=False)
    except ValueError:
        return json.dumps({name: _without_nan(value) for name, value in content.items()})


def hello_frame(info: np.ndarray, **more: object) -> str:
    """Return the first message to a client: the robot's information and further fields."""
    content = {name: _plain(info[name].tolist()) for name in info.dtype.names or ()}
    return json.dumps({"type": "hello", **more, **content})


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _without_nan(value: Any) -> Any:
    if isinstance(value, list):
        return [_without_nan(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _set(record: np.ndarray, field: str, values: list[float] | list[bool] | None, name: str) -> None:
    """Copy a list into an array field of the record; do nothing if the list is None."""
    if values is not None:
        record[field] = vector(values, len(record[field]), name=name)
