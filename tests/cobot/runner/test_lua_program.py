"""Lua programs: what they can do, what they cannot, and that they end when they have to.

Oracles: the Lua 5.3 reference manual (values, errors, lines), `websockets`' own server as the other end of
rosbridge, rosbags' serialisation for CDR, the operating system for exit statuses. The list of escapes is that
of lupa's documentation and of the Lua manual's list of functions that load code or open files.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest
from cobot_run import WAIT_S, until
from manual_programs import lua_example
from rosbags.typesys import Stores, get_typestore
from thorough import few
from websockets.sync.server import ServerConnection, serve

from cobot.client import Client
from cobot.errors import CobotError, InputError, MotionStopped, UnavailableError
from cobot.lua_functions import FUNCTIONS
from cobot.runner.lua_program import Program
from cobot.runner.lua_sandbox import LuaLimits, Stopping, run_apart
from cobot.runner.runner import say

ARRIVED = {"success": True, "message": "", "code": None, "motion_id": 7, "duration_s": 0.1}
POSE = {
    "position": {"x": 0.1, "y": 0.2, "z": 0.3},
    "orientation": {"euler_rad": {"a": 1.0, "b": 2.0, "c": 3.0}},
}


class Service:
    """Answers HTTP as told, and records it."""

    def __init__(self) -> None:
        self.posted: list[tuple[str, Any]] = []
        self.answers: dict[str, Any] = {}

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        if request.method == "POST":
            self.posted.append((path, json.loads(request.content)))
        known = {"/robot/joint_states": {"position": [0.5, 1.5]}, "/robot/pose": POSE}
        known["/health"] = {"robot": {"name": "iiwa"}}
        status, content = self.answers.get(path, (200, known.get(path, ARRIVED)))
        return httpx2.Response(status, text=json.dumps(content))


@pytest.fixture
def service() -> Service:
    return Service()


class Bridge:
    """The other end of rosbridge: answers calls, keeps what comes, sends what it is told to."""

    def __init__(self) -> None:
        self.received: list[dict[str, Any]] = []
        self.complaint = ""
        self.silent = False
        self.answer: Callable[[dict[str, Any], ServerConnection], None] = lambda message, to: None
        self._server = serve(self._serve, "127.0.0.1", 0)
        self.url = f"http://127.0.0.1:{self._server.socket.getsockname()[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()

    def ops(self, op: str) -> list[dict[str, Any]]:
        return [message for message in self.received if message["op"] == op]

    def _serve(self, connection: ServerConnection) -> None:
        assert connection.request is not None
        assert connection.request.path == "/rosbridge"
        for raw in connection:
            message = json.loads(raw)
            self.received.append(message)
            if self.complaint and message["op"] in ("advertise", "subscribe"):
                complaint = {"op": "status", "level": "error", "msg": self.complaint, "id": message["id"]}
                connection.send(json.dumps(complaint))
            if message["op"] == "call_service" and not self.silent:
                response = {"op": "service_response", "id": message["id"], "result": True, "values": {}}
                connection.send(json.dumps({**response, "service": message["service"]}))
            self.answer(message, connection)


@pytest.fixture
def bridge() -> Iterator[Bridge]:
    made = Bridge()
    yield made
    made.close()


def run(
    source: str | bytes,
    service: Service | None = None,
    url: str = "http://127.0.0.1:1",
    limits: LuaLimits | None = None,
) -> list[str]:
    """What the program has said."""
    said: list[str] = []
    with Client("http://robot", transport=httpx2.MockTransport(service or Service())) as client:
        program = Program(client, url, limits or LuaLimits(), said.append)
        text = source.encode() if isinstance(source, str) else source
        run_apart(lambda: program.run(text, "test.lua"), program.watch)
    return said


# What a program can do


def test_lua_is_lua_5_3() -> None:
    assert run("textmsg(_VERSION, 7 // 2, 3 | 4, math.type(3), utf8.len('µm'))") == ["Lua 5.3 3 7 integer 2"]


def test_editors_are_offered_the_functions_that_there_are() -> None:
    """Oracle: the environment of a program, without what Lua 5.3 has itself."""
    names = (
        "assert error getmetatable ipairs next pairs pcall rawequal rawget rawlen rawset select setmetatable "
        "tonumber tostring type xpcall"
    )
    own = {*names.split(" ")}
    tables = {"_G", "coroutine", "math", "robot", "string", "table", "utf8"}
    source = """for name, value in pairs(_G) do
      if type(value) == "function" then print(name) end
      if type(value) == "table" then
        print("table " .. name)
        if name == "gripper" then for each in pairs(value) do print("gripper." .. each) end end
      end
    end
    print(type(robot.call) == "function" and "robot.call")"""
    said = set(run(source))
    assert {name.removeprefix("table ") for name in said if name.startswith("table ")} == tables | {"gripper"}
    assert {name for name in said if not name.startswith("table ")} - own == FUNCTIONS.keys()


def test_textmsg_takes_anything_and_print_is_the_same() -> None:
    assert run("textmsg('a', nil, true, 2.5, nil) print(1)") == ["a nil true 2.5 nil", "1"]


def test_moves_are_those_of_the_http_api(service: Service) -> None:
    run(
        """
        movej({1, 2, 3})
        moveJoint({1, 2}, 0.5, 0.25)
        move_named("home", {speed = 0.75})
        movel({0.1, 0.2, 0.3, 1, 2, 3}, 0.5)
        movec({0.4, 0.5, 0.6}, {0.1, 0.2, 0.3, 1, 2, 3})
        """,
        service,
    )
    joints, scaled, named, line, arc = (body for _, body in service.posted)
    assert joints == {"joints": [1, 2, 3], "speed": 0.1, "accel_scale": 0.0}
    assert scaled == {"joints": [1, 2], "speed": 0.5, "accel_scale": 0.25}
    assert (named["name"], named["speed"]) == ("home", 0.75)
    assert (line["planner"], line["speed"]) == ("lin", 0.5)
    assert [line[key] for key in "xyzabc"] == [0.1, 0.2, 0.3, 3, 2, 1]  # rz, ry, rx
    assert (arc["planner"], arc["via"]) == ("circ", {"x": 0.4, "y": 0.5, "z": 0.6})


def test_options_are_those_of_the_motion(service: Service) -> None:
    run(
        """
        movej({1}, {planner = "auto", constraints = {joints = {joint1 = {-1, 1}}}})
        move_named("home", {})
        movel({0.1, 0.2, 0.3, 1, 2, 3}, {speed_m_s = 0.2, frame_id = "tool"})
        """,
        service,
    )
    joints, named, line = (body for _, body in service.posted)
    assert (joints["planner"], joints["constraints"]) == ("auto", {"joints": {"joint1": [-1, 1]}})
    assert named == {"name": "home", "speed": 0.1, "accel_scale": 0.0}
    assert (line["speed_m_s"], line["frame_id"], line.get("speed")) == (0.2, "tool", None)


def test_move_takes_the_waypoints_of_a_sequence_file(service: Service) -> None:
    run(
        """
        local up = {x = 0, y = 0, z = 1}
        move({named = "home", planner = "auto"})
        move({centre = up, axis = up, angle = 6.28, rise = 0.1, radius = 0.05},
             {x = 0.4, y = 0, z = 0.5, planner = "polyline", through = {{x = 0.4, y = 0.1, z = 0.5}},
              through_radius = 0.02},
             {joints = {1, 2}})
        """,
        service,
    )
    assert [path for path, _ in service.posted] == [
        "/robot/move/named",
        "/robot/move/sequence",
        "/robot/move/joints",
    ]
    named, several, _ = (body for _, body in service.posted)
    assert (named["name"], named["planner"]) == ("home", "auto")
    up = {"x": 0, "y": 0, "z": 1}
    assert several["radii"] == [0.05]
    assert several["motions"][0] == {"centre": up, "axis": up, "angle": 6.28, "rise": 0.1}
    assert several["motions"][1]["radius"] == 0.02


def test_the_state_is_read_as_tables(service: Service) -> None:
    source = "textmsg(table.unpack(get_joint_positions())) textmsg(table.unpack(getTcpPose()))"
    assert run(source, service) == ["0.5 1.5", "0.1 0.2 0.3 3.0 2.0 1.0"]


def test_vendor_services_answer_their_result(service: Service) -> None:
    path = "/iiwa/RobotAlgorithm/inverseKinematics"
    service.answers[path] = 200, {"code": 0, "message": "", "result": "[[1.5, 2], 0]"}
    service.answers["/iiwa/RobotConfig/getDof"] = 200, {"code": 0, "message": "", "result": 7}
    said = run(
        """
        textmsg(robot.call("RobotConfig", "getDof"), robot.RobotConfig.getDof())
        local answer = robot.RobotAlgorithm.inverseKinematics({qnear = {1, 2}, pose = {}})
        textmsg(from_json(answer)[1][1])
        """,
        service,
    )
    assert said == ["7 7", "1.5"]
    assert service.posted[-1] == (path, {"qnear": [1, 2], "pose": []})


def test_a_vendor_service_that_fails_is_an_error_with_its_line(service: Service) -> None:
    service.answers["/iiwa/A/b"] = 200, {"code": 11, "message": "too far", "result": 11}
    with pytest.raises(CobotError, match=r"test\.lua:2: A/b: too far \(code 11\)"):
        run("\nrobot.A.b({})", service)


@pytest.mark.parametrize(
    "source", ['robot.call("A/../x", "b")', 'robot.call("A", 1)', "robot.A.b({1, 2})", "robot.A.b(print)"]
)
def test_what_is_no_call_of_a_service_is_not_sent(service: Service, source: str) -> None:
    with pytest.raises(InputError, match=r"test\.lua:1: "):
        run(source, service)
    assert not service.posted


def test_json_goes_both_ways() -> None:
    source = """textmsg(to_json(from_json('[1, 2.5, "x", true, {"a": [3]}]')))"""
    assert run(source) == ['[1, 2.5, "x", true, {"a": [3]}]']


def test_coroutines_work() -> None:
    source = """
    local make = coroutine.wrap(function(a) while true do a = coroutine.yield(a + 1) end end)
    textmsg(make(1), make(5))
    local co = coroutine.create(function() error("inside") end)
    textmsg(coroutine.resume(co))
    textmsg(coroutine.status(co), select(2, coroutine.running()))
    """
    assert run(source) == ["2 6", "false test.lua:4: inside", "dead true"]


# Errors


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("local x = 1\nx = = 2", r"test\.lua:2: unexpected symbol near '='"),
        ("\n\nlocal x = nil; x.y = 1", r"test\.lua:3: attempt to index a nil value \(local 'x'\)"),
        ("\nmovej('here')", r"test\.lua:2: q must be a table of numbers, got a string"),
        ("movej({1, 'a'})", r"test\.lua:1: q\[2\] must be a number, got a string"),
        ("movej({0/0})", r"q\[1\] is (nan|-nan), allowed: finite numbers"),
        ("movel({1, 2, 3})", r"pose must be a table of 6 numbers"),
        ("movej({1}, 2)", r"speed is 2, allowed: finite numbers from 0 to 1"),
        ("movej({1}, {fast = 1})", r"the options are: actions, .*until, speed, accel_scale, planner, "),
        (
            "movel({1, 2, 3, 4, 5, 6}, {planner = 'ptp'})",
            r"the options are: actions, .*until, speed, accel_scale, speed_m_s, ",
        ),
        ("\nmove({x = 1, y = 2})", r"test\.lua:2: waypoints\[0\]\.z: is missing"),
        ("move({named = 'home'}, {angle = 1})", r"waypoints\[1\]\.centre: is missing"),
        ("move()", r"waypoints: must have at least 1 item"),
        ("move(1)", r"waypoints\[0\]: must be an object"),
        ("move_named()", r"the name must be a string, got nil"),
        ("sleep(-1)", r"sleep is -1"),
        ("sleep(print)", r"sleep must be a number, got a function"),
        ("from_json('{')", r"test\.lua:1: from_json: not valid JSON"),
        ("from_json(('['):rep(1e6))", r"not valid JSON"),
        ("local t = {} t[1] = t to_json(t)", r"nested more than 16 levels deep"),
        ("to_json({1, a = 2})", r"keys 1, 2, 3 \.\.\. or strings"),
        ("textmsg(('x'):rep(3, ',')) error('mine')", r"test\.lua:1: mine$"),
        ("error({})", r"an error that is not a text: table"),
        ("local function f() return 1 + {} end\nf()", r"test\.lua:1: attempt to perform arithmetic"),
        ("require('os')", r"there is no module 'os' here; valid is: ros_bind"),
        ("move_named('\\xff')", r"the name is not UTF-8 text"),
    ],
)
def test_errors_name_the_line_and_what_is_wrong(source: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(source)


def test_the_services_errors_keep_their_kind_and_get_the_line(service: Service) -> None:
    service.answers["/robot/move/joints"] = (
        200,
        {**ARRIVED, "success": False, "code": "stopped", "message": "no"},
    )
    with pytest.raises(MotionStopped, match=r"^test\.lua:2: no \(code 31\)$"):
        run("\nmovej({1})", service)
    said = run("local ok, why = pcall(movej, {1}) textmsg(ok, type(why), why)", service)
    assert said == ["false string no (code 31)"]


def test_a_caught_error_is_not_the_one_that_ends_the_program(service: Service) -> None:
    service.answers["/robot/move/joints"] = 503, {"code": "unavailable", "detail": "gone"}
    with pytest.raises(InputError, match="mine"):
        run("pcall(movej, {1}) error('mine')", service)


def test_an_error_of_megabytes_is_cut_with_its_size() -> None:
    with pytest.raises(InputError, match=r"\.\.\. \(1000001\d bytes\)$") as caught:
        run("error(string.rep('x', 10000000))")
    assert len(str(caught.value)) < 11_000


def test_what_the_service_says_reaches_a_program_whatever_characters_it_has(service: Service) -> None:
    """A lone surrogate is no UTF-8: its error must not reach the program as an object of Python's."""
    service.answers["/robot/move/joints"] = 503, {"code": "unavailable", "detail": "gone \ud800\x1b[2J"}
    said = run("local ok, why = pcall(movej, {1}) textmsg(type(why), why)", service)
    assert said == ["string gone \\ud800\x1b[2J (code 50)"]  # the log makes escapes of the rest
    service.answers["/iiwa/A/b"] = 200, {"code": 0, "message": "", "result": {"\ud800": "\ud801"}}
    assert run("for key, value in pairs(robot.A.b({})) do textmsg(#key, #value) end", service) == ["3 3"]


@pytest.mark.parametrize(
    "source",
    [
        "error(setmetatable({}, {__tostring = function() error('again') end}))",
        "error(setmetatable({}, {__tostring = function() return 7 end}))",
        "error(setmetatable({}, {__name = string.rep('n', 1000000)}))",
        "textmsg(setmetatable({}, {__tostring = function() error('again') end}))",
    ],
)
def test_a_value_without_text_ends_the_program_in_words(source: str) -> None:
    with pytest.raises(InputError) as caught:
        run(source)
    assert len(str(caught.value)) < 11_000


def test_what_a_program_prints_is_bounded_in_width_and_lines(capsys: pytest.CaptureFixture[str]) -> None:
    say("x" * 1_000_000)
    say("\n" * 1_000_000)
    say("\x1b[2J\0\u202e\ud800")
    wide, *lines, last = capsys.readouterr().out.splitlines()
    assert len(wide) < 11_000
    assert len(lines) < 250
    assert all(line.startswith("    | ") for line in lines[1:])
    assert last.endswith(r"program: \x1b[2J\x00\u202e\ud800")


def test_bytecode_is_no_program() -> None:
    with pytest.raises(InputError, match="attempt to load a binary chunk"):
        run(b"\x1bLua\x53\x00\x19\x93\r\n")


# No way out

ESCAPES = [
    "python.eval('1')",
    "python.builtins.open('/etc/passwd')",
    "return python.as_attrgetter(movej).__globals__",
    "os.execute('true')",
    "os.exit(0)",
    "io.open('/etc/passwd')",
    "io.popen('true')",
    "dofile('/etc/passwd')",
    "loadfile('/etc/passwd')",
    "load('return 1')",
    "loadstring('return 1')",
    "package.loadlib('libc.so.6', '*')",
    "package.searchpath('x', '?')",
    "require('io')",
    "require('debug')",
    "debug.getregistry()",
    "debug.sethook()",
    "debug.getupvalue(movej, 1)",
    "debug.setmetatable('', {})",
    "string.dump(function() end)",
    "('').dump(function() end)",
    "getmetatable('').__index.dump(function() end)",
    "collectgarbage('stop')",
    "_G._G.os.execute('true')",
    "_ENV.io.open('x')",
    "coroutine.close(coroutine.create(print))",
    "movej.__class__.__init__.__globals__.x = 1",
    "textmsg.__self__.x = 1",
    "require('ros_bind').ros_publisher_factory.__globals__.x = 1",
    "local ok, e = pcall(movej) return e.__class__.__mro__",
    "setmetatable({}, {__gc = function() end})",
    "local m = {} setmetatable({}, m) m.__gc = print setmetatable({}, m)",
    "getmetatable(robot).__index = 1",
]


@pytest.mark.parametrize("source", ESCAPES)
def test_there_is_no_way_out(source: str) -> None:
    with pytest.raises(InputError, match=r"test\.lua:1: "):
        run(source)


def test_nothing_that_can_be_reached_is_an_object_of_pythons(bridge: Bridge) -> None:
    """Walks through all tables and their metatables; in Lua, an object of Python's is a userdata."""
    source = """
    local ros_bind = require("ros_bind")
    roots = { _G, ros_bind, robot.X, robot.X.y, getmetatable(""), select(2, pcall(movej)) }
    roots[#roots + 1] = ros_bind.ros_publisher_factory("/a", "std_msgs/msg/String")
    roots[#roots + 1] = ros_bind.ros_subscriber_factory("/b", "std_msgs/msg/String")
    local seen, count = {}, 0
    local function visit(value)
      assert(type(value) ~= "userdata", "found one")
      if value == nil or seen[value] then return end
      seen[value], count = true, count + 1
      visit(getmetatable(value))
      if type(value) == "table" then
        for key, item in next, value do visit(key) visit(item) end
      end
    end
    visit(roots)
    textmsg(count > 100)
    """
    assert run(source, url=bridge.url) == ["true"]


def test_what_a_program_does_to_its_library_stays_there() -> None:
    source = """
    tostring, type, pcall, error, select, coroutine.create, string.match = nil
    getmetatable("").__index = nil
    setmetatable = nil
    textmsg(1, nil, true)
    robot.call(1)
    """
    with pytest.raises(InputError, match=r"test\.lua:6: the class must be a string, got a number"):
        run(source)


# Limits and the end

ENDLESS_INDEX = "local t = setmetatable({}, {__index = function(t, k) return t[k] end}) "
BUSY = [
    "while true do end",
    "::again:: goto again",
    "while true do pcall(function() while true do end end) end",
    "while true do pcall(function() while true do pcall(function() while true do end end) end end) end",
    "xpcall(function() while true do end end, function() while true do end end)",
    "coroutine.wrap(function() while true do pcall(function() while true do end end) end end)()",
    "local function f() while true do coroutine.resume(coroutine.create(f)) end end f()",
    "local function g() for i = 1, 1000 do end end while true do pcall(coroutine.wrap(g)) end",
    "local function f() while true do pcall(coroutine.wrap(function() f() end)) end end f()",
    ENDLESS_INDEX + "while true do pcall(function() return t.x end) end",
    "while true do table.sort({3, 2, 1}, function(a, b) return a < b end) end",
    "while true do (('x'):rep(1000)):gsub('.', function() pcall(error, 'x') end) end",
]


@pytest.mark.parametrize("source", BUSY)
def test_a_program_that_never_waits_ends_at_its_limit(source: str) -> None:
    with pytest.raises(InputError, match=r"more than 3000000 instructions without waiting|stack overflow"):
        run(source, limits=LuaLimits(instructions=3_000_000))


def test_the_limit_names_the_line_that_was_running() -> None:
    with pytest.raises(InputError, match=r"^test\.lua:3: more than"):
        run(
            "local function f()\n  pcall(function()\n while true do end end) end f()",
            limits=LuaLimits(instructions=100_000),
        )


def test_waiting_gives_a_program_new_instructions() -> None:
    source = "for i = 1, 20 do for k = 1, 100000 do end sleep(0) end textmsg('done')"
    assert run(source, limits=LuaLimits(instructions=1_000_000)) == ["done"]


@pytest.mark.parametrize(
    "source",
    [
        "local s = 'x' while true do s = s .. s end",
        "local t = {} while true do t[#t + 1] = {} end",
        "local s = ('x'):rep(1e9)",
        "local s = ('x'):rep(1e6, ('y'):rep(1000))",
        "local t = {} for i = 1, 1e9 do t[i] = coroutine.create(print) end",
        "string.format('%99s', 'x'):rep(1e6)",
    ],
)
def test_memory_is_limited(source: str) -> None:
    with pytest.raises(InputError, match=r"not enough memory|stack overflow|too many"):
        run(source, limits=LuaLimits(memory_bytes=16 << 20))


def test_a_program_goes_on_after_a_refused_allocation() -> None:
    source = "textmsg(pcall(string.rep, 'x', 1e9)) textmsg(#('x'):rep(1000000))"
    said = run(source, limits=LuaLimits(memory_bytes=16 << 20))
    assert said[0].startswith("false not enough memory")
    assert said[1] == "1000000"


@pytest.mark.parametrize("source", [*BUSY, "sleep(1000)", "pcall(sleep, 1000) while true do end"])
def test_a_program_that_is_told_to_end_ends(source: str) -> None:
    """Whatever catches errors in it. The deadline only fails when it does not end at all."""
    with Client("http://robot", transport=httpx2.MockTransport(Service())) as client:
        program = Program(client, "http://127.0.0.1:1", LuaLimits(instructions=0), lambda _: None)
        outcome: list[BaseException] = []

        def work() -> None:
            try:
                program.run(b"textmsg('x') " + source.encode(), "test.lua")
            except (Stopping, CobotError) as exc:
                outcome.append(exc)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        program.watch.end("enough")
        thread.join(WAIT_S)
    assert not thread.is_alive()
    assert isinstance(outcome[0], Stopping) or "stack overflow" in str(outcome[0])


# Topics


@pytest.mark.skipif(lua_example() is None, reason="the manual does not lie beside this clone")
def test_the_manuals_example_runs(bridge: Bridge) -> None:
    """The one in its chapter 3, word for word; the other side answers what is written, on the topic that is
    read.
    """

    def answer(message: dict[str, Any], to: ServerConnection) -> None:
        if message["op"] == "publish":
            echo = {"op": "publish", "topic": "/demo/from_ros", "msg": {"data": message["msg"]["data"] + "!"}}
            to.send(json.dumps(echo))

    bridge.answer = answer
    assert run(str(lua_example()), url=bridge.url) == ["recv: hello from lua!"]
    advertised, subscribed = bridge.ops("advertise")[0], bridge.ops("subscribe")[0]
    assert (advertised["topic"], advertised["type"]) == ("/demo/from_lua", "std_msgs/msg/String")
    assert (subscribed["topic"], subscribed["queue_length"]) == ("/demo/from_ros", 10)


def test_nothing_read_in_time_is_false(bridge: Bridge) -> None:
    source = """
    local sub = require("ros_bind").ros_subscriber_factory("/a", "std_msgs/msg/Bool", 3)
    textmsg(sub:read_timeout(1))
    textmsg(sub:read_timeout(0))
    """
    assert run(source, url=bridge.url) == ["false nil", "false nil"]
    assert bridge.ops("subscribe")[0]["queue_length"] == 3


@pytest.mark.parametrize(
    ("type_", "value", "data"),
    [
        ("String", "'µ\\n'", "µ\n"),
        ("Bool", "true", True),
        ("Int32", "-5", -5),
        ("Int32", "5.0", 5),
        ("UInt8", "255", 255),
        ("Int64", "math.mininteger", -(2**63)),
        ("UInt64", "math.maxinteger", 2**63 - 1),
        ("Float64", "2", 2.0),
        ("Float64", "0/0", None),
        ("Float32", "0.5", 0.5),
        ("Char", "65", 65),
        ("Byte", "1", 1),
    ],
)
def test_atoms_are_plain_values_both_ways(bridge: Bridge, type_: str, value: str, data: Any) -> None:
    def answer(message: dict[str, Any], to: ServerConnection) -> None:
        if message["op"] == "publish":
            to.send(json.dumps({**message, "topic": "/b"}))

    bridge.answer = answer
    source = f"""
    local r = require("ros_bind")
    local pub = r.ros_publisher_factory("/a", "std_msgs/msg/{type_}")
    local sub = r.ros_subscriber_factory("/b", "std_msgs/msg/{type_}")
    local value = {value}
    assert(pub:write(value))
    local ok, back = sub:read()
    textmsg(ok, back == value or back ~= back and value ~= value, type(back))
    """
    kind = {"Bool": "boolean", "String": "string"}.get(type_, "number")
    assert run(source, url=bridge.url) == [f"true true {kind}"]
    assert bridge.ops("publish")[0]["msg"] == {"data": data}


@pytest.mark.parametrize(
    ("type_", "value"),
    [
        ("Bool", "1"),
        ("Int8", "128"),
        ("Int32", "1.5"),
        ("UInt16", "-1"),
        ("String", "5"),
        ("String", "'\\xff'"),
        ("Float32", "1e39"),
        ("Float64", "{}"),
        ("Int32", "nil"),
        ("Header", "{}"),
        ("Header", "'too short'"),
    ],
)
def test_values_that_are_none_of_the_type_are_refused(bridge: Bridge, type_: str, value: str) -> None:
    source = f"""local pub = require("ros_bind").ros_publisher_factory("/a", "std_msgs/msg/{type_}")
    pub:write({value})"""
    with pytest.raises(InputError, match=rf"test\.lua:2: .*{type_}"):
        run(source, url=bridge.url)
    assert not bridge.ops("publish")


def test_other_messages_are_strings_of_cdr(bridge: Bridge) -> None:
    """rosbags makes the bytes and reads them; there are zeros and bytes above 127 in them."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/Vector3"
    sent = types.serialize_cdr(types.types[kind](x=-1.5, y=0.0, z=1e300), kind)

    def answer(message: dict[str, Any], to: ServerConnection) -> None:
        if message["op"] == "publish":
            to.send(json.dumps({**message, "topic": "/b"}))

    bridge.answer = answer
    escaped = "".join(f"\\x{byte:02x}" for byte in bytes(sent))
    source = f"""
    local r = require("ros_bind")
    local pub = r.ros_publisher_factory("/a", "{kind}")
    local sub = r.ros_subscriber_factory("/b", "{kind}")
    local bytes = "{escaped}"
    pub:write(bytes)
    local ok, back = sub:read_timeout(10000)
    textmsg(ok, back == bytes, #back, string.unpack("<d", back, 5))
    """
    assert run(source, url=bridge.url) == [f"true true {len(sent)} -1.5 13"]
    assert bridge.ops("publish")[0]["msg"] == {"x": -1.5, "y": 0.0, "z": 1e300}


def test_a_number_beyond_luas_integers_is_a_float(bridge: Bridge) -> None:
    def answer(message: dict[str, Any], to: ServerConnection) -> None:
        if message["op"] == "publish":
            to.send(json.dumps({"op": "publish", "topic": "/b", "msg": {"data": 2**64 - 1}}))

    bridge.answer = answer
    source = """
    local r = require("ros_bind")
    local sub = r.ros_subscriber_factory("/b", "std_msgs/msg/UInt64")
    r.ros_publisher_factory("/a", "std_msgs/msg/Bool"):write(true)
    local ok, value = sub:read()
    textmsg(value == 2.0^64, math.type(value))
    """
    assert run(source, url=bridge.url) == ["true float"]


def test_the_newest_messages_are_kept(bridge: Bridge) -> None:
    def answer(message: dict[str, Any], to: ServerConnection) -> None:
        if message["op"] == "publish":
            for number in range(5):
                to.send(json.dumps({"op": "publish", "topic": "/b", "msg": {"data": number}}))
            to.send(json.dumps({"op": "publish", "topic": "/done", "msg": {"data": True}}))

    bridge.answer = answer
    source = """
    local r = require("ros_bind")
    local sub = r.ros_subscriber_factory("/b", "std_msgs/msg/Int32", 2)
    local done = r.ros_subscriber_factory("/done", "std_msgs/Bool")
    r.ros_publisher_factory("/a", "std_msgs/msg/Bool"):write(true)
    done:read()
    textmsg(sub:read()) textmsg(sub:read()) textmsg(sub:read_timeout(0))
    """
    assert run(source, url=bridge.url) == ["true 3", "true 4", "false nil"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ("", "the topic must be a string, got nil"),
        ("'/a'", "the message type must be a string, got nil"),
        ("'/a', 'std_msgs/msg/Nothing'", "there is no type 'std_msgs/msg/Nothing'"),
        ("'/a', 'std_msgs/msg/Bool', 0", "keep_last is 0"),
        ("'/a', 'std_msgs/msg/Bool', 'x'", "keep_last must be a number"),
        ("'/a', 'std_msgs/msg/Bool', 1e9", "keep_last is 1e\\+09"),
    ],
)
@pytest.mark.parametrize("factory", ["ros_publisher_factory", "ros_subscriber_factory"])
def test_wrong_topics_are_refused_with_the_line(
    bridge: Bridge, factory: str, arguments: str, reason: str
) -> None:
    with pytest.raises(InputError, match=rf"test\.lua:2: {reason}"):
        run(f'local r = require("ros_bind")\nr.{factory}({arguments})', url=bridge.url)


def test_what_the_service_has_against_a_topic_is_an_error_with_the_line(bridge: Bridge) -> None:
    bridge.complaint = "/a has the type std_msgs/msg/Bool"
    with pytest.raises(InputError, match=r"test\.lua:2: /a has the type"):
        run(
            'local r = require("ros_bind")\nr.ros_publisher_factory("/a", "std_msgs/msg/Int8")',
            url=bridge.url,
        )


def test_closed_topics_are_closed(bridge: Bridge) -> None:
    source = """local r = require("ros_bind")
    local pub = r.ros_publisher_factory("/a", "std_msgs/msg/Bool")
    local sub = r.ros_subscriber_factory("/b", "std_msgs/msg/Bool")
    pub:close() pub:close() sub:close()
    pub:write(true)"""
    with pytest.raises(InputError, match=r"test\.lua:5: /a was closed"):
        run(source, url=bridge.url)
    until(lambda: bridge.ops("unadvertise") and bridge.ops("unsubscribe"))
    assert len(bridge.ops("unadvertise")) == 1


def test_no_more_topics_than_a_limit(bridge: Bridge) -> None:
    source = """
    local r = require("ros_bind")
    for i = 1, 300 do r.ros_publisher_factory("/a" .. i, "std_msgs/msg/Bool") end"""
    with pytest.raises(InputError, match="256 publishers and subscribers are open"):
        run(source, url=bridge.url)


def test_without_a_service_topics_are_unavailable() -> None:
    source = 'local r = require("ros_bind")\nr.ros_publisher_factory("/a", "std_msgs/msg/Bool")'
    with pytest.raises(UnavailableError, match=r"test\.lua:2: ws://127\.0\.0\.1:1/rosbridge"):
        run(source)


def test_a_lost_connection_is_an_error_not_a_hang(bridge: Bridge) -> None:
    def answer(message: dict[str, Any], to: ServerConnection) -> None:
        if message["op"] == "publish":
            to.close()

    bridge.answer = answer
    source = """local r = require("ros_bind")
    local sub = r.ros_subscriber_factory("/b", "std_msgs/msg/Bool")
    r.ros_publisher_factory("/a", "std_msgs/msg/Bool"):write(true)
    sub:read()"""
    with pytest.raises(UnavailableError, match=r"test\.lua:4: .*rosbridge"):
        run(source, url=bridge.url)


# As a process


def start(tmp_path: Path, source: str, *arguments: str) -> subprocess.Popen[str]:
    file = tmp_path / "test.lua"
    file.write_text(source, encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "cobot.runner",
        "run",
        str(file),
        "--url",
        "http://127.0.0.1:1",
        *arguments,
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.parametrize(
    ("source", "returncode"),
    few(
        [
            ("textmsg('x')", 0),
            ("x = = 1", 2),
            ("error('mine')", 2),
            ("movej({0})", 4),
            ("require('ros_bind').ros_publisher_factory('/a', 'std_msgs/msg/Bool')", 4),
        ],
        2,
    ),
)
def test_return_codes_are_those_of_sequences(tmp_path: Path, source: str, returncode: int) -> None:
    process = start(tmp_path, source)
    output, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == returncode, output
    assert "Traceback" not in output


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize(
    "source",
    few(
        [
            "while true do pcall(function() while true do end end) end",
            "sleep(1000)",
            "local x = ('a'):rep(100000):find((('.-'):rep(50)) .. 'b')",  # no instruction of Lua's for hours
            "table.move({}, 1, math.maxinteger - 1, 2)",
        ],
        2,
    ),
)
def test_a_signal_ends_whatever_runs(tmp_path: Path, source: str, number: signal.Signals) -> None:
    process = start(tmp_path, f"textmsg('begun') {source}")
    assert process.stdout is not None
    assert "begun" in process.stdout.readline()
    process.send_signal(number)
    output, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 128 + number
    assert f"ended by {number.name}" in output


def test_a_program_is_repeated_and_its_iterations_are_reported(tmp_path: Path) -> None:
    read_end, write_end = os.pipe()
    file = tmp_path / "a.lua"
    file.write_text("n = (n or 0) + 1 textmsg('n', n)", encoding="utf-8")
    command = [sys.executable, "-m", "cobot.runner", "run", str(file), "--iterations", "2"]
    with os.fdopen(read_end) as pipe:
        done = subprocess.run(
            [*command, "--progress-fd", str(write_end)],
            capture_output=True,
            text=True,
            pass_fds=(write_end,),
            timeout=WAIT_S,
            check=True,
        )
        os.close(write_end)
        assert [json.loads(line)["iteration"] for line in pipe] == [1, 2]
    assert done.stdout.count("n 1") == 2  # each iteration has a runtime of its own


def test_the_syntax_can_be_checked_without_running_anything(tmp_path: Path) -> None:
    file = tmp_path / "a.lua"
    for source, returncode, words in (("movej({0})", 0, ""), ("\nmovej({0}", 2, "a.lua:2: ')' expected")):
        file.write_text(source, encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-m", "cobot.runner", "check", str(file)],
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )
        assert done.returncode == returncode
        assert words in done.stderr


def test_a_program_may_come_through_standard_input_with_its_name() -> None:
    command = [sys.executable, "-m", "cobot.runner", "run", "-", "--name=pick.lua"]
    done = subprocess.run(
        command, input="error('here')", capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert done.returncode == 2
    assert "pick.lua:1: here" in done.stdout
