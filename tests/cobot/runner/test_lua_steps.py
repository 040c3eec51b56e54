"""Steps in Lua. Oracles: what the service receives; the same poses from the Python client's pallets."""

from __future__ import annotations

import json
import threading
from typing import Any

import httpx2
import pytest

from cobot.client import Client
from cobot.client.pallets import places
from cobot.errors import CobotError, ExecutionError, InputError
from cobot.runner.lua_program import Program
from cobot.runner.lua_sandbox import LuaLimits, Stopping, run_apart

ARRIVED = {"success": True, "message": "", "code": None, "motion_id": 7, "duration_s": 0.1}


class Service:
    """Keeps what it is asked for; the input `part` is true from the given read on."""

    def __init__(self, *, part_at: int = 1) -> None:
        self.asked: list[Any] = []
        self.failures: list[str] = []
        self.reads, self.part_at = 0, part_at

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        if request.method == "GET":
            self.reads += 1
            value = self.reads >= self.part_at
            point = {"name": "part", "kind": "boolean", "direction": "input", "value": value}
            return httpx2.Response(200, json={"points": [point]})
        body = json.loads(request.content) if request.content else None
        self.asked.append((request.url.path.removeprefix("/robot/"), body))
        if self.failures:
            code = self.failures.pop(0)
            return httpx2.Response(
                200, json={**ARRIVED, "success": False, "message": "too far", "code": code}
            )
        return httpx2.Response(200, json=ARRIVED)


@pytest.fixture
def service() -> Service:
    return Service()


def run(source: str, service: Service, **options: Any) -> list[str]:
    """What the program has said."""
    said: list[str] = []
    with Client("http://robot", transport=httpx2.MockTransport(service)) as client:
        program = Program(client, "http://127.0.0.1:1", LuaLimits(), said.append, **options)
        run_apart(lambda: program.run(source.encode(), "test.lua"), program.watch)
    return said


def test_outputs_are_set_and_inputs_waited_for(service: Service) -> None:
    service.part_at = 3
    events: list[dict[str, Any]] = []
    said = run(
        """
        set('belt', true)
        local seconds = wait_for({input = 'part', is = true}, 5)
        set('level', 0.5) wait_s(0) print(seconds < 5)
        """,
        service,
        report=events.append,
    )
    assert said == ["true"]
    assert service.reads == 3
    assert service.asked == [("io/belt", {"value": True}), ("io/level", {"value": 0.5})]
    assert [(event["event"], event["content"]) for event in events[:4]] == [
        ("start", "set belt to true"),
        ("done", "set belt to true"),
        ("start", "wait until part is true, up to 5 s"),
        ("done", "wait until part is true, up to 5 s"),
    ]


def test_the_gripper_has_its_commands(service: Service) -> None:
    run("gripper.release() gripper.grasp {width = 0.04, force = 20} gripper.stop()", service)
    grasp = ("gripper/grasp", {"width": 0.04, "force": 20})
    assert [path for path, _ in service.asked] == ["gripper/release", "gripper/grasp", "gripper/stop"]
    assert service.asked[1] == grasp


def test_the_motions_with_force_have_their_names(service: Service) -> None:
    events: list[dict[str, Any]] = []
    said = run(
        """
        print(press {force = 10, duration_s = 0.5}.motion_id)
        follow {force = 8, motion = {x = 0.5, y = 0.1, z = 0.4, planner = "lin"}}
        search {force = 8, ["until"] = {input = "in_hole", is = true}}
        insert {force = 8, depth = 0.02}
        """,
        service,
        report=events.append,
    )
    assert said == ["7"], "the answer of the service"
    assert service.asked == [
        ("force/press", {"force": 10, "duration_s": 0.5}),
        ("force/follow", {"force": 8, "motion": {"x": 0.5, "y": 0.1, "z": 0.4, "planner": "lin"}}),
        ("force/search", {"force": 8, "until": {"input": "in_hole", "is": True}}),
        ("force/insert", {"force": 8, "depth": 0.02}),
    ]
    assert [(each["event"], each["content"]) for each in events[:2]] == [
        ("start", "press (force 10.0, duration_s 0.5)"),
        ("done", "press (force 10.0, duration_s 0.5)"),
    ]


def test_an_input_that_does_not_come_is_an_error_with_its_line() -> None:
    with pytest.raises(ExecutionError, match=r"test.lua:2: wait_for: part is true did not"):
        run("\nwait_for({input = 'part', is = true}, 0)", Service(part_at=100))


def test_a_place_is_the_same_as_in_python(service: Service) -> None:
    run(
        """
        local origin = {x = 0.4, y = 0.1, z = 0.2, a = 0.5, b = 3.0, frame_id = "table"}
        for place in pallet(origin, {2, 2}, {{x = 0.05}, {y = 0.06}}) do
          assert(place.number >= 1)
          move(place:at {z = -0.1, planner = "lin", speed = 0.5})
        end
        """,
        service,
    )
    origin = {"x": 0.4, "y": 0.1, "z": 0.2, "a": 0.5, "b": 3.0, "frame_id": "table"}
    found = [place.at(z=-0.1) for place in places(origin, [2, 2], [{"x": 0.05}, {"y": 0.06}])]
    assert len(found) == 4
    for (path, body), expected in zip(service.asked, found, strict=True):
        assert path == "move/pose"
        assert {name: body[name] for name in "xyzabc"} == pytest.approx(
            {name: expected[name] for name in "xyzabc"}
        )
        assert (body["frame_id"], body["planner"]) == ("table", "lin")


def test_work_is_done_again_until_it_succeeds(service: Service) -> None:
    service.failures = ["execution", "unreachable"]
    said = run(
        """
        local one, two = on_error(function() move_named("table") return 1, 2 end, {
          retry = 2, run = function(reason) print(reason) end })
        print(one, two)
        """,
        service,
    )
    assert [line.partition(" (code")[0] for line in said] == ["test.lua:2: too far"] * 2 + ["1 2"]
    assert [path for path, _ in service.asked] == ["move/named"] * 3


def test_the_last_error_is_raised_or_dropped(service: Service) -> None:
    service.failures = ["execution"] * 3
    move = "function() move_named('table') end"
    assert run(f"print(on_error({move}, {{retry = 1, go_on = true}}))", service) == [""]
    with pytest.raises(ExecutionError, match="too far"):
        run(f"on_error({move})", service)


@pytest.mark.parametrize("code", ["stopped", "limit", "unavailable"])
def test_what_no_retry_can_heal_is_raised_at_once(service: Service, code: str) -> None:
    service.failures = [code]
    with pytest.raises(CobotError, match="too far"):
        run("on_error(function() move_named('table') end, {retry = 5, go_on = true})", service)
    assert len(service.asked) == 1


def test_a_mistake_of_the_program_is_not_retried(service: Service) -> None:
    with pytest.raises(InputError, match="attempt to call a nil value"):
        run("on_error(function() set('lamp', true) mvoe() end, {retry = 5, go_on = true})", service)
    assert len(service.asked) == 1


def test_nothing_catches_the_end_of_a_program(service: Service) -> None:
    with Client("http://robot", transport=httpx2.MockTransport(service)) as client:
        program = Program(client, "http://127.0.0.1:1", LuaLimits(), lambda _: None)
        begun = threading.Event()
        program._steps._paused_s = lambda: begun.set() or 0.0  # type: ignore[func-returns-value]
        ended: list[str] = []
        source = b"on_error(function() wait_s(1000) end, {retry = 5, go_on = true}) set('lamp', true)"

        def work() -> None:
            try:
                program.run(source, "test.lua")
            except Stopping as exc:
                ended.append(str(exc))

        thread = threading.Thread(target=work)
        thread.start()
        assert begun.wait(30.0)
        program.watch.end("told to end")
        thread.join(30.0)
    assert ended == ["told to end"]
    assert service.asked == []


def test_a_sequence_file_is_called(service: Service) -> None:
    called: list[str] = []
    run("call('pick.json')", service, call=called.append)
    assert called == ["pick.json"]


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("set(1, true)", "the output must be a string, got a number"),
        ("gripper.move {}", "gripper.width: is missing"),
        ("gripper.grasp(1)", "takes a table such as"),
        ("gripper.grasp {widht = 1}", "unknown key 'widht' .did you mean 'width'"),
        ("press(10)", "press takes a table such as {force = 10}"),
        ("press {}", "press.force: is missing"),
        ("press {force = 10, max_force = 5}", "press: max_force is 5 N; it must be above force"),
        ("insert {force = 10}", "insert.depth: is missing"),
        ("search {forse = 10}", "unknown key 'forse' .did you mean 'force'"),
        ("follow {force = 1, motion = {x = 1, y = 0, z = 0}}", "ptp does not follow a TCP path"),
        ("set('lamp')", "the value of lamp must be a number, got nil"),
        ("set('lamp', 'on')", "the value of lamp must be a number, got a string"),
        ("wait_for({input = 'part'})", "a condition is"),
        ("wait_for('part')", "a condition is"),
        ("wait_for({input = 'part', is = true}, -1)", "timeout_s is -1, allowed: 0 to 86400 s"),
        ("wait_for({input = 'prat', is = true})", "there is no input 'prat'; the inputs are: part"),
        ("wait_s(-1)", "wait_s is -1, allowed: finite numbers from 0 to 86400"),
        ("wait_s(0/0)", "wait_s is nan"),
        ("call(nil)", "the file must be a string, got nil"),
        ("pallet()", "pallet: origin: must be an object"),
        ("pallet({x = 0, y = 0, z = 0}, {0}, {{x = 1}})", r"counts\[0\] is 0, allowed: 1 to 10000"),
        (
            "pallet({x = 0, y = 0, z = 0}, {1000, 1000}, {{x = 1}, {y = 1}})",
            "1000000 places, allowed: 1 to",
        ),
        ("for p in pallet({x = 0, y = 0, z = 0}, {1}, {{x = 1}}) do p:at('x') end", "at takes a table"),
        ("for p in pallet({x = 0, y = 0, z = 0}, {1}, {{x = 1}}) do p:at{x = 'a'} end", "x must be a number"),
        ("on_error()", "on_error takes a function"),
        ("on_error(print, {retries = 1})", "the options of on_error are retry, run and go_on; got retries"),
        ("on_error(print, {retry = -1})", "retry must be a whole number from 0 to 1000"),
        ("on_error(print, {retry = 0.5})", "retry must be a whole number"),
    ],
)
def test_what_makes_no_sense_is_an_error_with_its_line(service: Service, source: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"test.lua:1: .*{words}"):
        run(source, service)
    assert service.asked == []
