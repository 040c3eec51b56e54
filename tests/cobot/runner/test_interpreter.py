"""Steps of sequences, run in this process against a service whose inputs change with a virtual clock.

Oracles: the order of what the service receives, written out by hand; times of the clock; for places of
pallets scipy's rotations, which the code does not use.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.client import Client
from cobot.errors import CobotError, ExecutionError, InputError, NotFoundError
from cobot.runner.interpreter import Interpreter
from cobot.runner.library import Library
from cobot.runner.pace import BURST, MAX_STEPS_PER_S
from cobot.runner.progress import Progress
from cobot.runner.schema import sequence_of

PART = {"input": "part", "is": True}
HOME = {"named": "home"}


class Stopped(BaseException):
    """What a signal raises in the runner: no handler of errors catches it."""


class Time:
    """A clock that a sleep sets forward."""

    def __init__(self) -> None:
        self.time_s = 100.0
        self.end_s = 1e9

    def now_s(self) -> float:
        return self.time_s

    def now_ns(self) -> int:
        return int(self.time_s * 1e9)

    wall_ns = now_ns

    def sleep(self, seconds: float) -> None:
        self.time_s += seconds
        if self.time_s > self.end_s:
            raise Stopped

    def ticker(self, rate_hz: float, on_tick: Callable[[int], None]) -> Any:
        raise NotImplementedError


class Robot:
    """A service: keeps what it is asked for, and has the inputs of this moment."""

    def __init__(self) -> None:
        self.time = Time()
        self.asked: list[Any] = []
        self.inputs: dict[str, Callable[[float], Any]] = {"part": lambda s: False, "level": lambda s: 0.5}
        self.answers: dict[str, list[tuple[int, dict[str, Any]]]] = {}
        self.reads = 0

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        if request.method == "GET":
            self.reads += 1
            return httpx2.Response(200, json={"points": self._points()})
        body = json.loads(request.content)
        if path.startswith("/robot/io/"):
            self.asked.append((path.removeprefix("/robot/io/"), body["value"]))
        else:
            self.asked.append(body.get("name") or body)
        arrived = {"success": True, "message": "", "code": None, "motion_id": 7, "duration_s": 0.1}
        waiting = self.answers.get(path.removeprefix("/robot/"))
        status, answer = waiting.pop(0) if waiting else (200, arrived)
        return httpx2.Response(status, json=answer)

    def _points(self) -> list[dict[str, Any]]:
        since_s = self.time.time_s - 100.0
        values = {name: value(since_s) for name, value in self.inputs.items()}
        kinds = {name: "boolean" if isinstance(value, bool) else "analog" for name, value in values.items()}
        points = [
            {"name": name, "kind": kinds[name], "direction": "input", "value": value}
            for name, value in values.items()
        ]
        return [*points, {"name": "lamp", "kind": "boolean", "direction": "output", "value": False}]


@pytest.fixture
def robot() -> Robot:
    return Robot()


def run(
    robot: Robot, *steps: Any, folder: Path = Path(), progress: Progress | None = None, iterations: int = 1
) -> list[str]:
    """The log of a run of a sequence with these steps."""
    lines: list[str] = []
    with Client("http://robot", transport=httpx2.MockTransport(robot)) as client:
        library = Library(folder)
        sequence = sequence_of({"steps": list(steps)})
        library.require(sequence, "main.json")
        interpreter = Interpreter(
            client, library, progress or Progress(None, None), lines.append, clock=robot.time
        )
        try:
            for iteration in range(1, iterations + 1):
                interpreter.run(sequence, iteration, iterations)
        except CobotError as exc:
            lines.append(f"error: {exc}")
            raise
    return lines


def failing(*codes: str) -> list[tuple[int, dict[str, Any]]]:
    return [
        (
            200,
            {
                "success": False,
                "message": f"went wrong: {code}",
                "code": code,
                "motion_id": 7,
                "duration_s": 0,
            },
        )
        for code in codes
    ]


def set_lamp(value: bool) -> dict[str, Any]:
    return {"set": {"output": "lamp", "value": value}}


def test_steps_run_in_order_and_are_in_the_log(robot: Robot) -> None:
    lines = run(robot, HOME, set_lamp(True), {"wait_s": 1.5, "label": "glue dries"}, {**set_lamp(False)})
    assert robot.asked == ["home", ("lamp", True), ("lamp", False)]
    assert robot.time.time_s == pytest.approx(101.5)
    assert lines == [
        "iteration 1/1, step 1 of 4: start",
        "iteration 1/1, step 1 of 4: arrived after 0.10 s",
        "iteration 1/1, step 2 of 4: set lamp to true",
        "iteration 1/1, step 3 of 4 (glue dries): wait 1.5 s",
        "iteration 1/1, step 4 of 4: set lamp to false",
    ]


def test_the_gripper_is_commanded_and_a_missed_part_is_tried_again(robot: Robot) -> None:
    robot.answers["gripper/grasp"] = failing("execution")
    grasp = {"gripper": {"command": "grasp", "width": 0.04, "force": 20}}
    opened = {"gripper": {"command": "release"}}
    lines = run(robot, {"on_error": {"retry": 1, "run": [opened]}, "do": [grasp]})
    assert robot.asked == [{"width": 0.04, "force": 20}, {}, {"width": 0.04, "force": 20}]
    assert lines[0] == "iteration 1/1, step 1.1 of 1: gripper: grasp (width 0.04, force 20.0)"
    assert "iteration 1/1, step 1.run.1 of 1: gripper: release" in lines


def test_the_error_of_a_step_has_its_place_and_what_the_service_says_of_it(robot: Robot) -> None:
    """Oracle: the table of details in docs/conventions.md."""
    reason = {"reason_code": "gripper_nothing", "reason_values": [0.042, None]}
    (status, answer), *_ = failing("execution")
    robot.answers["gripper/grasp"] = [(status, answer | {"details": reason})]
    with pytest.raises(ExecutionError, match="step 2 of 2: went wrong") as caught:
        run(robot, HOME, {"gripper": {"command": "grasp"}})
    assert caught.value.details == reason | {"step": "2", "message": "went wrong: execution"}


def test_a_wait_ends_when_its_input_has_the_value(robot: Robot) -> None:
    robot.inputs["part"] = lambda s: s >= 3.0
    run(robot, {"wait_for": PART, "timeout_s": 10}, set_lamp(True))
    assert robot.time.time_s == pytest.approx(103.0, abs=0.06)
    assert robot.asked == [("lamp", True)]


@pytest.mark.parametrize(
    ("condition", "fulfilled"),
    [({"above": 0.4}, True), ({"above": 0.5}, False), ({"below": 0.6}, True), ({"below": 0.5}, False)],
)
def test_an_analog_input_is_compared_with_a_number(
    robot: Robot, condition: dict[str, float], fulfilled: bool
) -> None:
    run(robot, {"if": {"input": "level", **condition}, "then": [set_lamp(True)], "else": [set_lamp(False)]})
    assert robot.asked == [("lamp", fulfilled)]


def test_an_input_that_does_not_come_fails_its_step_with_what_it_is(robot: Robot) -> None:
    with pytest.raises(ExecutionError) as caught:
        run(robot, HOME, {"repeat": {"count": 2}, "do": [{"wait_for": PART, "timeout_s": 2.0}]})
    assert str(caught.value) == (
        "iteration 1/1, step 2.1 of 2 (round 1 of 2): wait_for: part is true did not become true within 2 s; "
        "the input is false. Check the sensor, or give a longer timeout_s"
    )
    assert robot.time.time_s == pytest.approx(102.0)


@pytest.mark.parametrize("step", ["wait_for", "if", "while", "until"])
def test_an_unknown_input_ends_the_sequence_wherever_it_stands(robot: Robot, step: str) -> None:
    none = {"input": "prat", "is": True}
    steps = {
        "wait_for": {"wait_for": none},
        "if": {"if": none, "then": [HOME]},
        "while": {"repeat": {"while": none}, "do": [HOME]},
        "until": {"repeat": {"until": none}, "do": [HOME]},
    }
    rescued = {
        "on_error": {"retry": 3, "go_on": True},
        "do": [steps[step]],
    }  # a mistake is not an error to retry
    with pytest.raises(
        NotFoundError, match=r"step 1.1 of 1: there is no input 'prat'; the inputs are: part, level"
    ):
        run(robot, rescued)


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ({"input": "level", "is": True}, 'level is analog: its condition needs "above" or "below"'),
        ({"input": "part", "above": 1}, 'part is boolean: its condition needs "is"'),
        ({"input": "lamp", "is": True}, "lamp is an output; a condition needs an input"),
    ],
)
def test_a_condition_that_does_not_fit_its_input_is_refused(
    robot: Robot, condition: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        run(robot, {"wait_for": condition})


def test_a_value_that_the_device_does_not_know_fulfils_no_condition(robot: Robot) -> None:
    robot.inputs["level"] = lambda s: None
    for condition in ({"above": -1e9}, {"below": 1e9}):
        with pytest.raises(ExecutionError, match="the input is null"):
            run(robot, {"wait_for": {"input": "level", **condition}, "timeout_s": 1})


def test_steps_are_repeated_a_number_of_times(robot: Robot) -> None:
    lines = run(robot, {"repeat": {"count": 3}, "do": [HOME, set_lamp(True)]})
    assert robot.asked == ["home", ("lamp", True)] * 3
    assert "iteration 1/1, step 1.2 of 1 (round 3 of 3): set lamp to true" in lines


def test_while_is_checked_before_and_until_after_a_round(robot: Robot) -> None:
    run(robot, {"repeat": {"while": PART}, "do": [HOME]})
    assert robot.asked == []
    run(robot, {"repeat": {"until": {"input": "part", "is": False}}, "do": [HOME]})
    assert robot.asked == ["home"]
    robot.inputs["part"] = lambda s: len(robot.asked) < 4
    run(robot, {"repeat": {"while": PART, "count": 100}, "do": [HOME]})
    assert robot.asked == ["home"] * 4


@pytest.mark.thorough
def test_a_loop_without_end_or_motion_keeps_its_pace_until_it_is_stopped(robot: Robot) -> None:
    """Oracle: the number of requests in ten minutes of the clock."""
    robot.time.end_s = robot.time.time_s + 600.0
    with pytest.raises(Stopped):
        run(robot, {"repeat": {}, "do": [{"if": PART, "then": [HOME]}]})
    assert robot.reads <= BURST + MAX_STEPS_PER_S * 600.0
    assert robot.reads > 1000
    assert robot.asked == []


def test_a_failed_step_is_done_again(robot: Robot) -> None:
    robot.answers["move/named"] = failing("execution", "unreachable")
    lines = run(robot, {"on_error": {"retry": 2, "run": [set_lamp(True)]}, "do": [HOME, set_lamp(False)]})
    assert robot.asked == ["home", ("lamp", True), "home", ("lamp", True), "home", ("lamp", False)]
    assert any(
        "step 1 of 1: attempt 2 of 3 failed: iteration 1/1, step 1.1 of 1: went wrong" in line
        for line in lines
    )
    assert "iteration 1/1, step 1.run.1 of 1: set lamp to true" in lines


def test_the_last_error_ends_the_sequence_unless_it_is_to_go_on(robot: Robot) -> None:
    robot.answers["move/named"] = failing("execution", "collision")
    with pytest.raises(CobotError, match=r"step 1.1 of 2: went wrong: collision"):
        run(robot, {"on_error": {"retry": 1}, "do": [HOME]}, set_lamp(True))
    assert robot.asked == ["home", "home"]
    robot.answers["move/named"] = failing("execution")
    run(robot, {"on_error": {"go_on": True}, "do": [HOME]}, set_lamp(True))
    assert robot.asked[2:] == ["home", ("lamp", True)]


@pytest.mark.parametrize("code", ["stopped", "limit", "input", "unavailable", "not_ready", "conflict"])
def test_a_stop_a_mistake_and_a_robot_that_is_away_are_never_retried(robot: Robot, code: str) -> None:
    robot.answers["move/named"] = failing(code)
    with pytest.raises(CobotError, match="went wrong"):
        run(robot, {"on_error": {"retry": 5, "go_on": True, "run": [set_lamp(True)]}, "do": [HOME]})
    assert robot.asked == ["home"]


def test_an_error_of_the_recovery_itself_ends_the_sequence(robot: Robot) -> None:
    robot.answers["move/named"] = failing("execution", "execution")
    with pytest.raises(CobotError, match=r"step 1.run.1 of 1: went wrong"):
        run(robot, {"on_error": {"retry": 5, "go_on": True, "run": [HOME]}, "do": [HOME]})


def test_a_pallet_is_filled_place_by_place(robot: Robot) -> None:
    """Oracle: scipy's rotations."""
    origin = {"x": 0.4, "y": 0.1, "z": 0.05, "a": 0.5, "b": 3.0, "c": -0.2, "frame_id": "table"}
    counts, offsets = [3, 2], [{"x": 0.05}, {"y": 0.08, "z": 0.01}]
    down = {"x": 0.01, "y": 0.0, "z": -0.1, "a": 0.3, "frame_id": "place", "planner": "lin"}
    lines = run(
        robot, {"pallet": {"origin": origin, "counts": counts, "offsets": offsets}, "do": [down, HOME]}
    )
    turn = Rotation.from_euler("ZYX", [0.5, 3.0, -0.2])
    expected = [
        np.array([0.4 + 0.05 * column, 0.1 + 0.08 * row, 0.05 + 0.01 * row]) + turn.apply([0.01, 0.0, -0.1])
        for row in range(2)
        for column in range(3)
    ]
    bodies = robot.asked[::2]
    assert robot.asked[1::2] == ["home"] * 6
    np.testing.assert_allclose([[body[axis] for axis in "xyz"] for body in bodies], expected, atol=1e-12)
    for body in bodies:
        found = Rotation.from_euler("ZYX", [body[axis] for axis in "abc"])
        assert (found.inv() * turn * Rotation.from_euler("Z", 0.3)).magnitude() < 1e-9
        assert (body["frame_id"], body["planner"]) == ("table", "lin")
    assert "iteration 1/1, step 1.2 of 1 (place 6 of 6): start" in lines


def test_what_a_motion_has_besides_its_pose_is_relative_to_the_place_too(robot: Robot) -> None:
    quarter = {"x": 1.0, "y": 0.0, "z": 0.0, "a": np.pi / 2}
    pallet = {"frame": "slot", "origin": quarter, "counts": [1], "offsets": [{}]}
    pose = {"x": 0.0, "y": 0.1, "z": 0.0, "frame_id": "slot"}
    via = {"x": 0.1, "y": 0.0, "z": 0.2}
    run(
        robot,
        {
            "pallet": pallet,
            "do": [
                {**pose, "planner": "circ", "via": via},
                {**pose, "planner": "polyline", "through": [{**via, "a": 0.1}]},
                {"centre": via, "axis": {"x": 1, "y": 0, "z": 0}, "angle": 1.0, "frame_id": "slot"},
                {**pose, "frame_id": "other"},
            ],
        },
    )
    circ, polyline, arc, other = robot.asked
    assert [circ["x"], circ["y"]] == pytest.approx([0.9, 0.0])
    assert circ["via"] == pytest.approx({"x": 1.0, "y": 0.1, "z": 0.2})
    assert polyline["through"][0]["a"] == pytest.approx(np.pi / 2 + 0.1)
    assert arc["centre"] == pytest.approx({"x": 1.0, "y": 0.1, "z": 0.2})
    assert arc["axis"] == pytest.approx({"x": 0.0, "y": 1.0, "z": 0.0}, abs=1e-12)
    assert (other["y"], other["frame_id"]) == (0.1, "other")


def test_a_pallet_can_stand_at_a_place_of_another_one(robot: Robot) -> None:
    turned = {"x": 0.4, "y": 0, "z": 0, "a": np.pi}
    layer = {"frame": "layer", "origin": turned, "counts": [2], "offsets": [{"z": 0.1}]}
    row = {"origin": {"x": 0, "y": 0, "z": 0, "frame_id": "layer"}, "counts": [2], "offsets": [{"x": 0.05}]}
    pose = {"x": 0, "y": 0, "z": 0, "frame_id": "place"}
    run(robot, {"pallet": layer, "do": [{"pallet": row, "do": [pose]}]})
    found = [[round(body[axis], 9) for axis in "xz"] for body in robot.asked]
    assert found == [[0.4, 0.0], [0.35, 0.0], [0.4, 0.1], [0.35, 0.1]]


def write(folder: Path, **files: Any) -> None:
    for name, steps in files.items():
        content = steps if isinstance(steps, dict) else {"steps": steps}
        (folder / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")


def test_a_called_sequence_runs_once_with_its_own_way_home(robot: Robot, tmp_path: Path) -> None:
    write(tmp_path, pick={"home": HOME, "waypoints": [{"named": "table"}]})
    lines = run(robot, set_lamp(True), {"call": "pick.json"}, set_lamp(False), folder=tmp_path)
    assert robot.asked == [("lamp", True), "home", "table", ("lamp", False)]
    assert "iteration 1/1, step 2 of 3, pick.json home: start" in lines
    assert "iteration 1/1, step 2 of 3, pick.json waypoint 1/1: start" in lines


def test_a_called_sequence_knows_the_place_of_its_caller(robot: Robot, tmp_path: Path) -> None:
    write(tmp_path, put=[{"x": 0, "y": 0, "z": 0.1, "frame_id": "place"}])
    pallet = {"origin": {"x": 0.4, "y": 0, "z": 0}, "counts": [2], "offsets": [{"x": 0.1}]}
    run(robot, {"pallet": pallet, "do": [{"call": "put.json"}]}, folder=tmp_path)
    assert [[round(body["x"], 9), body["z"]] for body in robot.asked] == [[0.4, 0.1], [0.5, 0.1]]


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, "steps[0].call: there is no file 'a.json'"),
        (
            {"a": [{"call": "a.json"}]},
            "a.json: steps[0].call: main.json calls a.json calls a.json: a sequence cannot",
        ),
        (
            {"a": [HOME, {"call": "b.json"}], "b": [{"repeat": {}, "do": [{"call": "a.json"}]}]},
            "main.json calls a.json calls b.json calls a.json: a sequence cannot call itself; use repeat",
        ),
        (
            {"a": [{"call": "main.json"}]},
            "main.json calls a.json calls main.json: a sequence cannot call itself",
        ),
        (
            {"a": [{"wait_s": -1}]},
            "steps[0].call: a.json: steps[0].wait_s: must be greater than or equal to 0, got -1",
        ),
        ({"a": [{"call": "../x.json"}]}, "'../x.json' is not below the programs folder"),
    ],
)
def test_a_call_that_cannot_be_is_refused_before_anything_moves(
    robot: Robot, tmp_path: Path, files: dict[str, Any], words: str
) -> None:
    write(tmp_path, **files)
    with pytest.raises(InputError) as caught:
        run(robot, HOME and {"call": "a.json"}, folder=tmp_path)
    assert words in str(caught.value)
    assert robot.asked == []


def test_calls_are_nested_to_a_limit_and_may_branch_without_one(robot: Robot, tmp_path: Path) -> None:
    write(tmp_path, **{f"n{n}": [{"call": f"n{n + 1}.json"}] * 2 for n in range(18)}, n18=[{"wait_s": 0}])
    robot.time.end_s = robot.time.time_s + 60.0
    with pytest.raises(Stopped):  # 2 ** 18 leaves: it runs for hours, and is read in no time
        run(robot, {"call": "n0.json"}, folder=tmp_path)
    with pytest.raises(InputError, match="nested more than 20 deep"):
        run(robot, {"repeat": {}, "do": [{"call": "n0.json"}]}, folder=tmp_path)


def test_a_jump_leaves_all_that_is_nested(robot: Robot) -> None:
    """Oracle: the answers of a service, as `app.services.programs.steps` gives them."""

    class Answers(Progress):
        def __init__(self, *answers: int | None) -> None:
            super().__init__(None, None)
            self.answers, self.asked = list(answers), []  # type: ignore[var-annotated]

        def ask(self, place: dict[str, Any]) -> int | None:
            self.asked.append((place["waypoint"], place["step"], self.behind))
            return self.answers.pop(0) if self.answers else None

    nested = {"on_error": {"go_on": True}, "do": [{"repeat": {}, "do": [HOME]}]}
    progress = Answers(None, None, None, None, None, 3, None)
    run(robot, set_lamp(True), nested, set_lamp(False), progress=progress)
    assert robot.asked == [("lamp", True), "home", "home", ("lamp", False)]
    assert progress.asked == [
        (1, "step 1 of 3", 0),
        (2, "step 2 of 3", 1),
        (2, "step 2.1 of 3", 1),
        (2, "step 2.1.1 of 3 (round 1)", 1),
        (2, "step 2.1.1 of 3 (round 2)", 1),
        (2, "step 2.1.1 of 3 (round 3)", 1),
    ]


def test_time_in_which_the_program_is_paused_does_not_count(robot: Robot) -> None:
    """The service answers a question within a wait once nothing is paused, with the time of all pauses."""

    class Paused(Progress):
        paused = 0.0

        def ask_paused_s(self) -> float:
            if robot.time.time_s >= 102.0 and not self.paused:  # paused from 101 s on, for 50 s
                self.paused = 50.0
                robot.time.time_s = max(robot.time.time_s, 151.0)
            return self.paused

    run(robot, {"wait_s": 2.0}, progress=Paused(None, None))
    assert robot.time.time_s == pytest.approx(152.0)
    robot.time.time_s = 100.0
    with pytest.raises(ExecutionError, match="within 3 s"):
        run(robot, {"wait_for": PART, "timeout_s": 3.0}, progress=Paused(None, None))
    assert robot.time.time_s == pytest.approx(153.0)


def test_progress_is_a_share_of_the_iteration(robot: Robot) -> None:
    shares: list[float] = []

    class Shares(Progress):
        def ask(self, place: dict[str, Any]) -> int | None:
            shares.append(place["share"])
            return None

    run(robot, HOME, {"repeat": {"count": 2}, "do": [HOME, HOME]}, progress=Shares(None, None))
    assert shares == pytest.approx([0.0, 0.5, 0.5, 0.625, 0.75, 0.875])
