"""The registry: how functions become services, and what a call does with what comes in.

Oracle: the design of the services ({code, message, result}, 0 is success, ROS defaults), written out by
hand; the rules of ROS 2's interface files for names; jsonschema_rs, a validator of others.
"""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import jsonschema_rs
import pytest

from app.aubo import classes, http, registry
from app.aubo.interfaces import PACKAGE, interface_definitions
from app.aubo.registry import REGISTRY, CallOrigin, Int64, Json, VendorAnswer, call, service
from cobot.codes import Code
from cobot.errors import LimitError, NotSupportedError
from cobot.ros.messages import Messages

ROBOT: Any = SimpleNamespace(ownership=SimpleNamespace(stops=3))


@pytest.fixture
def empty(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A registry of the test's own."""
    monkeypatch.setattr(registry, "REGISTRY", {})
    registry._type_names.cache_clear()
    yield
    registry._type_names.cache_clear()


def asked(method: str, **arguments: Any) -> VendorAnswer:
    return asyncio.run(call(ROBOT, "Test", method, arguments))


def echo(robot: Any, flag: bool, count: int, size: float, text: str, items: list[float]) -> Json:
    """Give back what came in.

    Args:
        flag: whether.
        count: how many,
            on two lines.
        size: m
        text: words
        items: rad

    Returns:
        JSON: all of it.
    """
    return [flag, count, size, text, items]


GOOD: dict[str, Any] = {"flag": True, "count": 3, "size": 1, "text": "é", "items": [1, 2.5]}


@pytest.mark.usefixtures("empty")
def test_a_call_gets_what_the_request_says_and_answers_with_code_zero() -> None:
    service("Test")(echo)
    assert asked("echo", **GOOD) == VendorAnswer(0, "", '[true,3,1.0,"\\u00e9",[1.0,2.5]]')
    found = registry.REGISTRY["Test", "echo"]
    assert (found.doc, found.type_name, found.result.doc) == (
        "Give back what came in.",
        "Echo",
        "JSON: all of it.",
    )
    assert [field.doc for field in found.parameters] == [
        "whether.",
        "how many, on two lines.",
        "m",
        "words",
        "rad",
    ]
    assert [field.ros_type for field in found.parameters] == [
        "bool",
        "int32",
        "float64",
        "string",
        "float64[]",
    ]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"flag": 1}, "flag: must be true or false, got 1"),
        ({"flag": None}, "flag: must be true or false, got null"),
        ({"count": 1.0}, "count: must be an integer, got 1.0"),
        ({"count": True}, "count: must be an integer, got true"),
        ({"count": 2**31}, "count: does not fit into int32, got 2147483648"),
        ({"size": "1"}, "size: must be a number, got '1'"),
        ({"size": float("nan")}, "size: must be finite, got NaN"),
        ({"size": 10**400}, "size: must be finite"),
        ({"text": 3}, "text: must be a string, got 3"),
        ({"text": "half \ud800"}, "text: is not valid Unicode: surrogates not allowed"),
        ({"items": [0.0] * 65_537}, "items: may have up to 65536 items, got 65537"),
        ({"items": None}, "items: must be a list, got null"),
        ({"items": [0.0, float("inf")]}, "items[1]: must be finite, got Infinity"),
        ({"items": [[0.0]]}, "items[0]: must be a number"),
        (
            {"itmes": []},
            "unknown key 'itmes' (did you mean 'items'?); valid keys: flag, count, size, text, items",
        ),
    ],
)
@pytest.mark.usefixtures("empty")
def test_what_is_wrong_with_a_field_is_said_with_its_place(change: dict[str, Any], sentence: str) -> None:
    service("Test")(echo)
    answer = asked("echo", **(GOOD | change))
    assert answer.code == Code.INPUT
    assert sentence in answer.message
    assert answer.result == ""


@pytest.mark.usefixtures("empty")
def test_a_missing_field_and_a_request_that_is_no_object_are_refused() -> None:
    service("Test")(echo)
    answer = asked("echo", flag=True, text="")
    assert (answer.code, answer.message) == (
        Code.INPUT,
        "count: is missing; required: count, size, items",
    )
    request: Any = [1]
    assert asyncio.run(call(ROBOT, "Test", "echo", request)).code == Code.INPUT


@pytest.mark.usefixtures("empty")
def test_what_ros_sends_for_nothing_stands_for_the_default() -> None:
    @service("Test")
    def defaults(
        robot: Any, v: float = 0.5, n: int = 7, name: str = "x", q: list[float] = (1.0,), j: Json = None
    ) -> Json:
        """Give back.

        Args:
            v: m/s
            n: of them
            name: whose
            q: rad
            j: JSON

        Returns:
            JSON.
        """
        return [v, n, name, q, j]

    whole = '[0.5,7,"x",[1.0],null]'
    assert asked("defaults").result == whole
    assert asked("defaults", v=0.0, n=0, name="", q=[], j="").result == whole
    assert asked("defaults", v=2, n=1, name="y", q=[3], j='{"a":1}').result == '[2.0,1,"y",[3.0],{"a":1}]'
    assert "j: is not valid JSON" in asked("defaults", j="{").message
    assert "occurs twice" in asked("defaults", j='{"a":1,"a":2}').message


@pytest.mark.usefixtures("empty")
def test_an_error_has_its_code_and_an_integer_result_repeats_it(caplog: pytest.LogCaptureFixture) -> None:
    def failing(name: str, error: Exception, annotation: Any) -> None:
        def function(robot: Any) -> Any:
            """Fail.

            Returns:
                Nothing.
            """
            raise error

        function.__annotations__["return"] = annotation
        service("Test", name=name)(function)

    failing("limit", LimitError("too far"), int)
    failing("unsupported", NotSupportedError("no such thing"), None)
    failing("text", LimitError("too far"), str)
    failing("list", LimitError("too far"), list[float])
    failing("broken", ZeroDivisionError("secret"), int)
    assert asked("limit") == VendorAnswer(Code.LIMIT, "too far", 11)
    assert asked("unsupported") == VendorAnswer(Code.NOT_SUPPORTED, "no such thing", 60)
    assert asked("text") == VendorAnswer(Code.LIMIT, "too far", "")
    assert asked("list") == VendorAnswer(Code.LIMIT, "too far", [])
    with caplog.at_level(logging.ERROR):
        answer = asked("broken")
    assert answer.code == Code.ERROR
    assert "secret" not in answer.message
    assert "Test/broken failed" in caplog.text


@pytest.mark.usefixtures("empty")
def test_a_service_that_asks_for_the_origin_gets_it_whoever_calls() -> None:
    seen = []

    @service("Test")
    async def move(robot: Any, origin: CallOrigin) -> None:
        """Move."""
        seen.append(origin)

    origin = CallOrigin("somebody", 2, "token")
    assert asyncio.run(call(ROBOT, "Test", "move", {}, origin)) == VendorAnswer(0, "", 0)
    assert asked("move").code == 0
    assert seen == [origin, CallOrigin("Test/move", 3)]


@pytest.mark.usefixtures("empty")
def test_a_service_that_is_not_there_is_named_with_those_that_are() -> None:
    service("Test")(echo)
    assert "unknown method 'ecoh' (did you mean 'echo'?); valid methods: echo" in asked("ecoh").message
    answer = asyncio.run(call(ROBOT, "Tset", "echo", {}))
    assert (answer.code, answer.message) == (Code.NOT_FOUND, "there is no class 'Tset'; valid names: Test")


@pytest.mark.usefixtures("empty")
def test_methods_of_one_name_share_a_type_only_if_they_are_alike() -> None:
    def stop(robot: Any) -> None:
        """Stop."""

    def stop_number(robot: Any, number: int) -> None:
        """Stop one.

        Args:
            number: of it.
        """

    service("One", name="stop")(stop)
    service("Two", name="stop")(stop)
    assert {found.type_name for found in registry.REGISTRY.values()} == {"Stop"}
    service("Three", name="stop")(stop_number)
    names = {found.robot_class: found.type_name for found in registry.REGISTRY.values()}
    assert names == {"One": "OneStop", "Two": "TwoStop", "Three": "ThreeStop"}


def _undocumented(robot: Any, x: float) -> None:
    """Say nothing of x."""


def _surplus(robot: Any) -> None:
    """Say too much.

    Args:
        x: is not there.
    """


def _silent(robot: Any) -> int:
    """Say nothing of the result."""
    return 0


def _nothing(robot: Any) -> None:
    pass


def _set(robot: Any, x: set[int]) -> None:
    """Take a set.

    Args:
        x: a set.
    """


def _on(robot: Any, x: bool = True) -> None:
    """Be on by default, which ROS could not switch off.

    Args:
        x: whether.
    """


@pytest.mark.parametrize(
    ("function", "sentence"),
    [
        (_undocumented, "does not describe x"),
        (_surplus, "describes x, but the function has no such parameter"),
        (_silent, "has no Returns:"),
        (_nothing, "has no docstring"),
        (_set, "x is a set[int], allowed: bool"),
        (_on, "x cannot be True by default"),
    ],
)
@pytest.mark.usefixtures("empty")
def test_a_function_that_cannot_be_a_service_is_refused_where_it_is_written(
    function: Callable[..., Any], sentence: str
) -> None:
    with pytest.raises(TypeError, match=re.escape(sentence)):
        service("Test")(function)


def _square(robot: Any, x: float) -> float:
    """Square.

    Args:
        x: any.

    Returns:
        x².
    """
    return x * x


def _squares(robot: Any, x: float) -> list[float]:
    """Square.

    Args:
        x: any.

    Returns:
        0 and x².
    """
    return [0.0, x * x]


def _said(robot: Any, x: float) -> Json:
    """Square.

    Args:
        x: any.

    Returns:
        JSON: x².
    """
    return {"square": x * x}


@pytest.mark.parametrize("function", [_square, _squares, _said])
@pytest.mark.usefixtures("empty")
def test_a_result_that_json_has_no_word_for_is_an_answer_all_the_same(function: Callable[..., Any]) -> None:
    service("Test", name="square")(function)
    assert asked("square", x=2.0).code == Code.OK
    answer = asked("square", x=1.3e308)
    assert (answer.code, answer.message) == (Code.INPUT, registry.TOO_LARGE)
    assert answer.result == registry.REGISTRY["Test", "square"].result.empty


def test_no_service_is_registered_twice() -> None:
    found = REGISTRY["RobotConfig", "getDof"]
    with pytest.raises(TypeError, match="registered twice"):
        service("RobotConfig")(found.function)


def test_every_name_is_one_that_ros_permits() -> None:
    assert len(REGISTRY) > 200
    for found in REGISTRY.values():
        assert re.fullmatch(r"[A-Z][A-Za-z0-9]*", found.robot_class)
        assert re.fullmatch(r"[a-z][A-Za-z0-9]*", found.method)
        assert re.fullmatch(r"[A-Z][A-Za-z0-9]*", found.type_name)
        for field in found.parameters:
            assert re.fullmatch(r"(?!.*__)[a-z][a-z0-9_]*(?<!_)", field.name), (found.type_name, field.name)


def test_every_class_of_the_manual_has_services_and_a_place_in_the_documentation() -> None:
    manual = (
        "Math Serial Socket SystemInfo RuntimeMachine RegisterControl SyncMove Trace RobotConfig "
        "MotionControl ForceControl IoControl RobotAlgorithm RobotManage RobotState"
    )
    assert set(manual.split()) == {key[0] for key in REGISTRY} == set(classes.CLASSES)


def test_every_method_that_the_manual_names_is_served() -> None:
    manual = {
        "RobotConfig": "getDof getName getCycletime",
        "RobotState": "getJointPositions isSteady",
        "MotionControl": "moveJoint moveLine moveCircle servoJoint servoCartesian setServoMode "
        "isServoModeEnabled getExecId stopMove startMove",
        "RobotAlgorithm": "inverseKinematics",
        "Math": "poseAdd poseSub poseTrans poseInverse rpyToQuaternion quaternionToRpy",
        "RuntimeMachine": "loadProgram runProgram start stop abort pause resume",
        "RegisterControl": "getBoolInput setBoolInput getInt32Register setInt16Register setWatchDog "
        "modbusAddSignal modbusGetSignalStatus",
        "SyncMove": "syncMoveSegment syncMoveOff frameAdd frameAttach axisGroupMoveJoint",
        "ForceControl": "fcEnable fcDisable isFcEnabled fcSetSensorThresholds fcSetSensorLimits",
        "Serial": "serialOpen serialClose serialReadString serialSendString",
        "Socket": "socketOpen socketClose socketReadString socketSendString",
    }
    named = {(robot_class, method) for robot_class, words in manual.items() for method in words.split()}
    assert named <= set(REGISTRY)


def test_each_services_failure_is_an_answer_of_its_schema_on_every_transport() -> None:
    messages = Messages(interface_definitions())
    kinds = set()
    for (robot_class, method), found in REGISTRY.items():
        answer = asyncio.run(call(ROBOT, robot_class, method, {"no_such_field": 1}))
        assert answer.code == Code.INPUT
        kinds.add(found.result.kind)
        jsonschema_rs.validate(http._schema(found.result), answer.result)
        content = {"code": int(answer.code), "message": answer.message, "result": answer.result}
        assert messages.checked(f"{PACKAGE}/srv/{found.type_name}_Response", content) == content
    assert {"int32", "int32[]", "float64[]", "string", "json"} <= kinds


def test_an_int64_may_be_larger_than_an_int32() -> None:
    def count(robot: Any, n: Int64) -> Int64:
        """Give back.

        Args:
            n: a number.

        Returns:
            It.
        """
        return n

    found = registry._described("Test", "count", count)
    assert found.result.ros_type == found.parameters[0].ros_type == "int64"
    assert registry.bind(found, {"n": 2**62}) == {"n": 2**62}
