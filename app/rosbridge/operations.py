"""The operations that rosbridge clients may send, and their validation.

Source: https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cobot.errors import InputError
from cobot.ros.messages import Message
from cobot.strict import sentences, shown

MAX_QUEUE = 10_000
Id = Annotated[str | int | None, Field(union_mode="left_to_right")]
Name = Annotated[str, Field(min_length=1, max_length=512)]


class Operation(BaseModel):
    """An operation. Unknown keys are ignored, because clients send keys of many protocol versions."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True)

    id: Id = None


class Answered(Operation):
    """An operation that has an answer. The answer may be sent in fragments."""

    compression: str | None = None
    fragment_size: Annotated[int, Field(ge=64)] | None = None


class Advertise(Operation):
    topic: Name
    type: Name
    latch: bool = False


class Unadvertise(Operation):
    """Ends an advertisement. If a gateway has advertised several types, `type` selects one."""

    topic: Name
    type: Name | None = None


class Publish(Operation):
    """Publishes a message. If a gateway has advertised the topic with several types, `type` selects one."""

    topic: Name
    type: Name | None = None
    msg: Message = {}
    latch: bool = False


class Subscribe(Answered):
    topic: Name
    type: Name | None = None
    throttle_rate: Annotated[float, Field(ge=0.0, le=3_600_000.0)] | None = None
    queue_length: Annotated[int, Field(ge=0)] | None = None


class Unsubscribe(Operation):
    topic: Name


class CallService(Answered):
    service: Name
    args: Message | list[Any] | None = None
    timeout: Annotated[float, Field(ge=0.0)] | None = None


class AdvertiseService(Operation):
    service: Name
    type: Name


class UnadvertiseService(Operation):
    service: Name


class ServiceResponse(Operation):
    service: Name
    values: Any = None
    result: bool = True


class AdvertiseAction(Operation):
    action: Name
    type: Name


class UnadvertiseAction(Operation):
    action: Name


class SendActionGoal(Answered):
    action: Name
    action_type: Name | None = None
    args: Message | list[Any] | None = None
    feedback: bool = False


class CancelActionGoal(Operation):
    action: Name


class ActionFeedback(Operation):
    action: Name
    values: Message = {}


class ActionResult(Operation):
    action: Name
    values: Any = None
    status: Annotated[int, Field(ge=0, le=6)] = 4
    result: bool = True


class Fragment(Operation):
    data: str
    num: Annotated[int, Field(ge=0)]
    total: Annotated[int, Field(ge=1)]


class Status(Operation):
    level: str = "info"
    msg: str = ""


class SetLevel(Operation):
    level: Literal["none", "error", "warning", "info"]


class Gateway(Operation):
    """A cobot-specific operation: the client mirrors the graph to another network, see
    `app.rosbridge.connection`.
    """


OPERATIONS: dict[str, type[Operation]] = {
    "advertise": Advertise,
    "unadvertise": Unadvertise,
    "publish": Publish,
    "subscribe": Subscribe,
    "unsubscribe": Unsubscribe,
    "call_service": CallService,
    "advertise_service": AdvertiseService,
    "unadvertise_service": UnadvertiseService,
    "service_response": ServiceResponse,
    "advertise_action": AdvertiseAction,
    "unadvertise_action": UnadvertiseAction,
    "send_action_goal": SendActionGoal,
    "cancel_action_goal": CancelActionGoal,
    "action_feedback": ActionFeedback,
    "action_result": ActionResult,
    "fragment": Fragment,
    "status": Status,
    "set_level": SetLevel,
    "cobot_gateway": Gateway,
}


def operation(content: Any) -> Operation:
    """Validate a decoded message.

    Raises:
        InputError: the message is invalid. The error gives the problem and the valid values.
    """
    if not isinstance(content, dict):
        raise InputError(f"a message must be a JSON object, got {shown(content)}")
    name = content.get("op")
    model = OPERATIONS.get(name) if isinstance(name, str) else None
    if model is None:
        raise InputError(f"there is no op {shown(name)}; valid names: {', '.join(OPERATIONS)}")
    try:
        return model.model_validate(content)
    except ValidationError as exc:
        raise InputError(f"{name}: {sentences(exc.errors())}") from exc
