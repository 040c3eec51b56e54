"""The functions that a Lua program can call. They use the REST API."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Set
from functools import partial
from typing import Any, TypeVar

from lupa.lua53 import lua_type

from cobot.addresses import ROBOTS
from cobot.client import Client
from cobot.codes import code_of
from cobot.errors import CobotError, ExecutionError, InputError
from cobot.motions.bodies import JointMotion, TcpMotion
from cobot.runner.blocks import groups
from cobot.runner.lua_sandbox import Function, LuaLimits, ProgramWatch, Sandbox
from cobot.runner.lua_steps import LuaSteps
from cobot.runner.lua_values import lua, number, numbers, plain, text
from cobot.runner.moving import go
from cobot.runner.ros_bind import RosBridge
from cobot.runner.schema import sequence_of
from cobot.runner.targets import Target
from cobot.strict import shown

Result = TypeVar("Result")
Report = Callable[[dict[str, Any]], None]
MAX_LINE = 10_000
MAX_SLEEP_S = 1e9
POSE = ("x", "y", "z", "c", "b", "a")
"""The fields for [x, y, z, rx, ry, rz]. Turning about fixed axes, x first, is the same as turning by KUKA's
ABC angles in reverse order.
"""
TO_JOINTS, TO_POSE = JointMotion.model_fields.keys(), TcpMotion.model_fields.keys()
"""The options of motions to joint angles, and of motions along a TCP path."""


class Program:
    """One run of one program.

    Attributes:
        watch: the object that tells the program to end.
    """

    def __init__(
        self,
        client: Client,
        url: str,
        limits: LuaLimits,
        log: Callable[[str], None],
        report: Report = lambda _: None,
        call: Callable[[str], None] = lambda _: None,
        paused_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """
        Args:
            url: URL of the service or of one of its robots, see `cobot.addresses`.
                        log: called with the output of the program.
            report: called at the start and the end of each motion and each other step.
            call: runs a sequence file.
            paused_s: function that returns the total time for which the program has been paused, s.
        """
        self.watch = ProgramWatch(limits.instructions)
        self._client = client
        self._log = log
        self._report = report
        root, _, robot = url.rstrip("/").partition(f"{ROBOTS}/")
        self._robot = robot
        self._begun_s = time.monotonic()
        self._bridge = RosBridge(root, self.watch)
        self._steps = LuaSteps(
            client,
            self.watch,
            self._run_in_thread,
            report,
            self._lua,
            lambda: self._sandbox.failure,
            call,
            paused_s,
        )
        self._sandbox = Sandbox(self._functions() | self._steps.functions(), self.watch, limits)

    def run(self, source: bytes, name: str) -> None:
        """Run the program to its end. See `Sandbox.run`."""
        try:
            self._sandbox.run(source, name)
        finally:
            self._bridge.close()

    def _functions(self) -> dict[str, Function]:
        """The host functions for `sandbox.lua`. It provides each function named program_NAME to the program
        as NAME.
        """
        bridge = self._bridge
        return {
            "textmsg": self._textmsg,
            "call": self._call,
            "advertise": bridge.advertise,
            "subscribe": bridge.subscribe,
            "publish": bridge.publish,
            "take": bridge.take,
            "close": bridge.finish,
            "program_sleep": self._sleep,
            "program_clock": lambda: time.monotonic() - self._begun_s,
            "program_from_json": self._from_json,
            "program_to_json": lambda value=None: json.dumps(plain(value, "the value")).encode(),
            "program_move": self._move,
            "program_moveJoint": self._move_joint,
            "program_moveLine": self._move_line,
            "program_moveCircle": self._move_circle,
            "program_move_named": self._move_named,
            "program_getJointPositions": self._joint_positions,
            "program_getTcpPose": self._tcp_pose,
        }

    def _textmsg(self, line: bytes) -> None:
        self._log(line[:MAX_LINE].decode("utf-8", "replace"))

    def _sleep(self, seconds: object = None) -> None:
        self.watch.sleep(number(seconds, "sleep", 0.0, MAX_SLEEP_S))

    def _from_json(self, content: object = None) -> Any:
        try:
            return self._lua(json.loads(text(content, "from_json")))
        except (ValueError, RecursionError) as exc:
            raise InputError(f"from_json: not valid JSON: {exc}") from exc

    def _move(self, *targets: object) -> None:
        """Move through waypoints, as in a sequence file. The arm does not stop at waypoints that have a
        radius.
        """
        sequence = sequence_of({"waypoints": [plain(target, "the target") for target in targets]})
        for chain in groups(sequence.waypoints):
            motion = [target for _, target in chain if isinstance(target, Target)]
            self._motion(f"move to {shown(motion[-1].body())}", partial(go, self._client, motion))

    def _move_joint(self, joints: object = None, speed: object = None, scale: object = None) -> None:
        angles, options = numbers(joints, "q"), _options(speed, scale, TO_JOINTS)
        self._motion(f"moveJoint to {angles}", lambda: self._client.move_joints(angles, **options))

    def _move_named(self, name: object = None, speed: object = None, scale: object = None) -> None:
        position, options = text(name, "the name"), _options(speed, scale, TO_JOINTS)
        self._motion(f"move_named to {position}", lambda: self._client.move_named(position, **options))

    def _move_line(self, pose: object = None, speed: object = None, scale: object = None) -> None:
        goal, options = numbers(pose, "pose", 6), _options(speed, scale, TO_POSE)
        where: dict[str, Any] = {**dict(zip(POSE, goal, strict=True)), **options}
        self._motion(f"moveLine to {goal}", lambda: self._client.move_pose(**where, planner="lin"))

    def _move_circle(
        self, via: object = None, pose: object = None, speed: object = None, scale: object = None
    ) -> None:
        middle, goal = numbers(via, "via"), numbers(pose, "pose", 6)
        options = _options(speed, scale, TO_POSE)
        if len(middle) not in (3, 6):
            raise InputError(f"via must be a table of 3 numbers, or a pose of 6, got {len(middle)}")
        where: dict[str, Any] = {**dict(zip(POSE, goal, strict=True)), **options}
        arc = dict(zip("xyz", middle, strict=False))
        self._motion(
            f"moveCircle to {goal}", lambda: self._client.move_pose(**where, planner="circ", via=arc)
        )

    def _joint_positions(self) -> Any:
        return self._lua(self._run_in_thread(self._client.joint_states)["position"])

    def _tcp_pose(self) -> Any:
        pose = self._run_in_thread(self._client.pose)
        position, angles = pose["position"], pose["orientation"]["euler_rad"]
        return self._lua([{**position, **angles}[key] for key in POSE])

    def _call(self, class_: object = None, method: object = None, arguments: Any = None) -> Any:
        """Call a vendor service and return its result. A code other than 0 is an error."""
        names = text(class_, "the class"), text(method, "the method")
        for name in names:
            if not name.isidentifier():
                raise InputError(f"{shown(name)} is not the name of a class or a method")
        fields = {} if arguments is None else plain(arguments, "the arguments")
        if fields == []:  # an empty table is a list and an object
            fields = {}
        if not isinstance(fields, dict):
            raise InputError("the arguments must be a table with their names: {q = {...}, v = 0.5}")
        if not self._robot:
            self._robot = str(self._run_in_thread(self._client.health)["robot"]["name"])
        try:
            answer = self._run_in_thread(lambda: self._client.call_service(self._robot, *names, fields))
        except CobotError as exc:  # rejected before the service processed it, for example because of its role
            raise exc.with_message(f"{'/'.join(names)}: {exc}") from exc
        if answer["code"] != 0:
            raise ExecutionError(f"{'/'.join(names)}: {answer['message']} (code {answer['code']})")
        return self._lua(answer["result"])

    def _motion(self, what: str, move: Callable[[], dict[str, Any]]) -> None:
        # The report may have to wait until the program is resumed.
        self._run_in_thread(lambda: self._report({"event": "start", "motion": what}))
        try:
            answer = self._run_in_thread(move)
        except CobotError as exc:
            self._report({"event": "failed", "motion": what, "reason": str(exc)})
            raise
        self._report({"event": "arrived", "motion": what, "motion_id": answer["motion_id"]})

    def _run_in_thread(self, work: Callable[[], Result]) -> Result:
        """Run a function in a separate thread, because it waits for the service, and return its result. If
        the program must end, the thread is abandoned.

        Raises:
            CobotError: the error of the function. Its text contains the code, because a program that catches
                the error gets only the text.
        """
        results: list[Result] = []
        problems: list[Exception] = []

        def do() -> None:
            try:
                results.append(work())
            except Exception as exc:  # noqa: BLE001 - raised below
                problems.append(exc)
            self.watch.wake()

        threading.Thread(target=do, name="request", daemon=True).start()
        self.watch.wait(lambda: bool(results or problems))
        if problems:
            problem = problems[0]
            if isinstance(problem, CobotError):
                raise problem.with_message(f"{problem} (code {int(code_of(problem))})") from problem
            raise problem
        return results[0]

    def _lua(self, value: Any) -> Any:
        return lua(value, self._sandbox.table)


def _options(speed: Any, scale: Any, valid: Set[str]) -> dict[str, Any]:
    """The options `speed` and `accel_scale` if they are given, or a table with these and other valid options.
    The service checks the options.
    """
    given = {"speed": speed, "accel_scale": scale}
    if lua_type(speed) == "table":
        given = plain(speed, "the options")
        if given == []:  # an empty table is a list and an object
            given = {}
        if not isinstance(given, dict) or not given.keys() <= valid:
            raise InputError(f"the options are: {', '.join(valid)}")
    for name in ("speed", "accel_scale"):
        if given.get(name) is not None:
            given[name] = number(given[name], name, 0.0, 1.0)
    return {name: value for name, value in given.items() if value is not None}
