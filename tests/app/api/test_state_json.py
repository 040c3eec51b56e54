"""GET /robot/state. Oracles: another reader of the same shared memory; the model in the schema; the table."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from virtual_service import VirtualService

from app.api.state_json import StateAnswer, state_content, state_response
from app.api.stream_frames import state_frame
from cobot.ipc.layout import GripperObject, Intervention, text
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.state_fields import STATE_FIELDS, state_dtype
from cobot.types import LoopMode


def random_state(seed: int, dof: int = 7) -> np.ndarray:
    random = np.random.default_rng(seed)
    state = np.zeros((), state_dtype(dof))
    for field in STATE_FIELDS:
        if field.kind == "f8":
            state[field.name] = random.normal(size=field.shape(dof))
        elif not field.is_text:
            state[field.name] = random.integers(0, 1000, field.shape(dof))
    state["gripper_object"] = random.integers(len(GripperObject))
    state["mode"], state["reason"] = random.integers(len(LoopMode)), "señal".encode()
    state["reason_code"], state["reason_of"], state["reason_unit"] = b"contact", "größe, 取".encode(), b"N"
    return state


def finite(value: Any) -> Any:
    """A number, a list of numbers or bytes, with None for what is not a number."""
    if isinstance(value, list):
        return [finite(each) for each in value]
    return None if value != value else value


def expected(state: np.ndarray) -> dict[str, Any]:
    """As a reader of shared memory would write it, field by field."""
    content = {name: state[name].tolist() for name in state.dtype.names or ()}
    content = {name: finite(value) for name, value in content.items()}
    content["gripper_object"] = GripperObject(int(state["gripper_object"])).name
    content["mode"] = LoopMode(int(state["mode"])).name
    for name in ("reason", "reason_code", "reason_of", "reason_unit"):
        content[name] = text(state[name])
    for name in ("interventions", "intervened_ns"):
        content[name] = {kind.name.lower(): int(state[name][kind]) for kind in Intervention}
    return content


@pytest.mark.parametrize("seed", range(20))
def test_the_answer_has_every_field_as_the_record_has_it(seed: int) -> None:
    state = random_state(seed, 1 + seed % 16)
    answer = bytes(state_response(state).body)
    assert json.loads(answer) == expected(state)
    StateAnswer.model_validate_json(answer, strict=True)
    frame = json.loads(state_frame(state, 4))
    assert frame == {"type": "state", "sequence": 4, **expected(state)}
    assert list(frame)[2:] == list(state_content(state)) == list(StateAnswer.model_fields)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_null(value: float) -> None:
    state = random_state(1)
    state["sensor"][2], state["path_rate"] = value, value

    def forbid(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    content = json.loads(bytes(state_response(state).body), parse_constant=forbid)
    assert content["sensor"][2] is content["path_rate"] is None
    StateAnswer.model_validate(content, strict=True)


def test_the_service_answers_what_another_reader_of_the_block_finds(service: VirtualService) -> None:
    reader = RobotMemory.attach(service.app.state.services.link.memory.robot, MemoryRole.READER)
    try:
        answer = service.get("/robot/state")
        read = expected(reader.state.read())
    finally:
        reader.close()
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    content = answer.json()
    assert content["mode"] == "HOLD"
    assert content == read


def test_it_answers_with_the_reason_while_the_robot_is_stopped(service: VirtualService) -> None:
    service.app.state.services.link.request_estop()
    service.sleep(0.5)
    content = service.get("/robot/state").json()
    assert (content["mode"], content["reason"]) == ("ESTOP", "e-stop requested")
    assert (content["reason_code"], content["reason_values"]) == ("estop_requested", [None, None])
    assert service.post("/robot/reset", json={}).status_code == 200


def test_the_schema_has_meaning_unit_and_topic_of_each_field(service: VirtualService) -> None:
    schema = service.get("/openapi.json").json()
    operation = schema["paths"]["/robot/state"]["get"]["responses"]["200"]
    assert operation["content"]["application/json"]["schema"]["$ref"].endswith("/StateAnswer")
    properties = schema["components"]["schemas"]["StateAnswer"]["properties"]
    for field in STATE_FIELDS:
        description = properties[field.name]["description"]
        assert description.startswith(f"{field.meaning}.")
        assert (f" Unit: {field.unit}." in description) == (field.unit != "")
        assert ("Recorded" in description) == (field.recorded != "")
        assert (f"Recorded in {field.topic}." in description) == (field.message is not None)
        assert properties[field.name].get("unit", "") == field.unit
