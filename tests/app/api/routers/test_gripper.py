"""The gripper over REST, on virtual time. Oracle: a toy, whose fingers go 0.2 m/s and stop at its part."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from virtual_service import VirtualService

from app.services.rights.claims import Caller
from cobot.client.jobs import JobHandle
from cobot.errors import (
    CobotError,
    DeviceError,
    ExecutionError,
    LimitError,
    MotionTimeout,
    NotReadyError,
    NotSupportedError,
)
from cobot.grippers.contract.toy import DEVICES, STROKE_M, ToyDevice
from cobot.motions.gripper_bodies import GripperMove

TOY = "gripper: {type: 'cobot.grippers.contract.toy:ToyGripper'%s}"
PART_M = 0.04


class Run:
    """A service, its toy and its client."""

    def __init__(self, service: VirtualService) -> None:
        self.service = service
        self.client = service.client("http://robot.test")

    @property
    def toy(self) -> ToyDevice:
        return DEVICES["toy"]

    def ask(self, command: str, body: dict[str, Any] | None = None, **query: object) -> Any:
        return self.service.post(f"/robot/gripper/{command}", body or {}, params=query)

    def begin(self, command: str, **body: object) -> JobHandle:
        answer = self.ask(command, body, wait=False)
        assert answer.status_code == 202, answer.text
        return JobHandle(self.client, answer.json()["id"])

    def state_of(self, job: JobHandle) -> tuple[str, str]:
        record = self.service.get(f"/jobs/{job.id}").json()
        return record["state"], (record["error"] or {"detail": ""})["detail"]

    def events(self) -> list[dict[str, Any]]:
        kept = self.service.app.state.events.since(0, 10_000)
        return [json.loads(each.text)["data"] for each in kept if each.type == "gripper"]


def serve(folder: Path, options: str = "", keys: str = "") -> Iterator[Run]:
    service = VirtualService(folder, of_robot=keys or TOY % options)
    DEVICES["toy"] = ToyDevice(service.clock.now_s)
    with service.serving():
        yield Run(service)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    yield from serve(tmp_path_factory.mktemp("gripper"))


@pytest.fixture
def run(shared: Run) -> Run:
    shared.toy.object_m, shared.toy.unplugged, shared.toy.fault = None, False, ""
    shared.service.until(shared.service.healthy)
    shared.client.gripper.release()
    shared.service.post("/stop")
    shared.service.post("/scene", {"clear": True}).raise_for_status()
    shared.service.go_home()
    return shared


def put_part(run: Run, mass: float = 0.5) -> None:
    """A part at the TCP, in the scene and between the fingers."""
    position = run.client.pose()["position"]
    place = {key: position[key] for key in "xyz"}
    run.client.put_object("part", "box", size=[PART_M, 0.04, 0.04], mass=mass, **place)
    run.toy.object_m = PART_M


def turn(run: Run, speed: float) -> dict[str, Any]:
    """The job of a motion about the first axis, which has begun."""
    joints = run.service.joints()
    body = {"joints": [joints[0] + 0.5, *joints[1:]], "speed": speed}
    answer = run.service.post("/robot/move/joints?wait=false", body)
    assert answer.status_code == 202, answer.text
    found: dict[str, Any] = answer.json()
    return found


def part(run: Run) -> dict[str, Any]:
    found: dict[str, Any] = next(each for each in run.client.scene()["objects"] if each["name"] == "part")
    return found


def test_a_move_goes_to_the_width_in_the_time_of_the_device(run: Run) -> None:
    begun_s = run.service.clock.now_s()
    answer = run.client.gripper.move(0.02, speed=0.1)
    assert isinstance(answer, dict)
    assert (answer["success"], answer["width"], answer["moving"]) == (True, 0.02, False)
    assert 0.8 <= run.service.clock.now_s() - begun_s <= 0.85


def test_a_grasp_attaches_the_part_at_the_tcp_and_a_release_detaches_it(run: Run) -> None:
    put_part(run)
    answer = run.client.gripper.grasp(PART_M, force=20.0)
    assert isinstance(answer, dict)
    assert (answer["object"], answer["held"], answer["force"]) == ("held_inside", "part", 20.0)
    run.service.until(lambda: part(run)["attached"])
    assert run.client.gripper.state()["held"] == "part"
    released = run.client.gripper.release()
    assert isinstance(released, dict)
    assert (released["held"], released["width"]) == (None, STROKE_M)
    run.service.until(lambda: not part(run)["attached"])
    what = [each["what"] for each in run.events()][-2:]
    assert what == ["grasped", "released"]


def test_a_grasp_while_the_arm_moves_is_attached_when_it_rests(run: Run) -> None:
    put_part(run)
    run.client.change_scene(allowed=[["part", "link7"]])
    turn(run, 0.3)
    run.service.until(lambda: run.client.state()["mode"] == "TRAJECTORY")
    run.client.gripper.grasp(PART_M)
    assert not part(run)["attached"]
    assert run.client.gripper.state()["held"] == "part"
    run.service.until(lambda: part(run)["attached"])
    assert run.client.state()["mode"] == "HOLD"


def test_a_grasp_of_nothing_is_an_error_unless_the_request_says_otherwise(run: Run) -> None:
    with pytest.raises(ExecutionError, match=r"closed on nothing at 0\.03.. m: no object is held"):
        run.client.gripper.grasp(PART_M)
    run.client.gripper.release()
    answer = run.client.gripper.grasp(PART_M, if_missed="success")
    assert isinstance(answer, dict)
    assert (answer["success"], answer["object"], answer["held"]) == (True, "none", None)


def test_an_object_of_another_width_is_an_error_that_names_both(run: Run) -> None:
    run.toy.object_m = 0.03
    answer = run.ask("grasp", {"width": 0.01, "tolerance_outer": 0.002}).json()
    assert not answer["success"]
    assert "something that is 0.0300 m wide; the expected width is 0.01 m" in answer["message"]
    assert (answer["object"], answer["held"]) == ("held_inside", None)


def test_a_new_command_replaces_the_running_one_whose_job_is_cancelled(run: Run) -> None:
    first = run.begin("move", width=0.0, speed=0.01)
    run.service.sleep(0.5)
    answer = run.client.gripper.move(0.09)
    assert isinstance(answer, dict)
    assert answer["success"]
    state, error = run.state_of(first)
    assert (state, error) == ("cancelled", "preempted by move of anonymous from 127.0.0.1")


def test_a_cancelled_job_and_a_stop_end_the_command_with_the_fingers_where_they_are(run: Run) -> None:
    ends: list[Callable[[JobHandle], object]] = [
        lambda job: job.cancel(),
        lambda _: run.service.post("/stop"),
        lambda _: run.client.gripper.stop(),
    ]
    for end in ends:
        run.client.gripper.release()
        job = run.begin("move", width=0.0, speed=0.01)
        run.service.sleep(0.5)
        end(job)
        run.service.sleep(0.1)
        width = run.toy.width_m()
        assert 0.09 < width < 0.097
        run.service.sleep(1.0)
        assert run.toy.width_m() == width
        assert run.state_of(job)[0] == "cancelled"


def test_a_stop_keeps_the_grip(run: Run) -> None:
    put_part(run)
    run.client.gripper.grasp(PART_M)
    run.service.post("/stop")
    run.service.sleep(1.0)
    state = run.client.gripper.state()
    assert (state["state"]["object"], state["held"]) == ("held_inside", "part")


def test_a_lost_part_is_detached_told_and_stops_the_motion(run: Run) -> None:
    put_part(run)
    run.client.gripper.grasp(PART_M)
    run.service.until(lambda: part(run)["attached"])
    motion = turn(run, 0.2)
    run.service.until(lambda: run.client.state()["mode"] == "TRAJECTORY")
    run.toy.object_m = None
    run.service.until(lambda: run.service.get(f"/jobs/{motion['id']}").json()["state"] == "cancelled")
    error = run.service.get(f"/jobs/{motion['id']}").json()["error"]["detail"]
    assert "the gripper has lost part" in error
    run.service.until(lambda: not part(run)["attached"])
    state = run.client.gripper.state()
    assert (state["state"]["object"], state["held"]) == ("lost", None)
    assert run.events()[-1] == {"what": "lost", "object": "part", "stops": True}


@pytest.mark.parametrize(
    ("command", "body", "words"),
    [
        ("move", {"width": 0.2}, r"width is 0\.2 m, .* allows 0 to 0\.1 m"),
        ("grasp", {"width": 0.05, "force": 500.0}, r"force is 500 N, .* allows 5 to 50 N"),
        ("move", {"width": 0.05, "speed": 3.0}, r"speed is 3 m/s, .* allows 0\.01 to 0\.2 m/s"),
    ],
)
def test_a_value_out_of_range_is_rejected_with_the_range_and_nothing_moves(
    run: Run, command: str, body: dict[str, float], words: str
) -> None:
    before = run.toy.target_m
    with pytest.raises(LimitError, match=words):
        run.client._json("POST", f"/robot/gripper/{command}", json=body)
    assert run.toy.target_m == before


@pytest.mark.parametrize("body", [{}, {"width": "x"}, {"width": 0.05, "colour": "red"}, {"width": -1}])
def test_a_body_that_is_wrong_is_a_422(run: Run, body: dict[str, object]) -> None:
    assert run.ask("move", body).status_code == 422


def test_an_unplugged_gripper_fails_the_command_degrades_health_and_comes_back(run: Run) -> None:
    job = run.begin("move", width=0.0, speed=0.01)
    run.service.sleep(0.5)
    run.toy.unplugged = True
    run.service.until(lambda: run.state_of(job)[0] == "failed")
    assert "the toy does not answer: no answer; check its plug" in run.state_of(job)[1]
    with pytest.raises(DeviceError, match="does not answer"):
        run.client.gripper.move(0.05)
    health = run.service.health()
    assert health["status"] == "degraded"
    assert any("the toy does not answer" in each for each in health["problems"])
    assert not run.client.gripper.state()["connected"]
    run.toy.unplugged = False
    run.service.until(lambda: run.client.gripper.state()["connected"])
    assert run.service.healthy()


def test_a_fault_of_the_device_is_the_reason_of_a_failed_command(run: Run) -> None:
    run.toy.fault = "its motor is too hot"
    with pytest.raises(CobotError, match="its motor is too hot"):
        run.client.gripper.move(0.05)


@pytest.mark.parametrize(
    ("garbage", "words"),
    [
        ({"width": float("nan")}, "width is NaN"),
        ({"width": "abc"}, "width is 'abc'; it must be a number"),
        ({"commanded_width": True}, "commanded_width is true"),
        ({"force": 10**400}, "force is 1000"),
        ({"temperature": float("-inf")}, "temperature is -Infinity"),
        ({"moving": "no"}, "moving is 'no'"),
        ({"object": "held_inside"}, "object is 'held_inside'; it must be a HeldObject"),
        ({"fault": None}, "fault or a key of ages_s is null"),
        ({"ages_s": {"width": "old"}}, "ages_s, width is 'old'"),
    ],
)
def test_a_driver_that_reports_garbage_is_a_problem_until_it_reports_values(
    run: Run, monkeypatch: pytest.MonkeyPatch, garbage: dict[str, Any], words: str
) -> None:
    driver = run.service.app.state.services.gripper._worker.gripper
    report = driver.state
    with monkeypatch.context() as patch:
        patch.setattr(driver, "state", lambda: replace(report(), **garbage))
        run.service.until(lambda: words in run.client.gripper.state()["problem"])
        with pytest.raises(DeviceError, match="an error in its driver"):
            run.client.gripper.move(0.05)
        assert run.client.gripper.state()["state"]["width"] == STROKE_M  # the last one that was a width
    run.service.until(lambda: run.client.gripper.state()["connected"])
    assert run.service.healthy()


def test_a_stop_while_the_driver_does_not_return_is_an_error_and_follows(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker = run.service.app.state.services.gripper._worker
    back, in_thread = asyncio.Event(), worker._in_thread

    async def hang(*arguments: Any) -> Any:
        worker._calling_since_s = run.service.clock.now_s()
        await back.wait()
        return await in_thread(*arguments)

    job = run.begin("move", width=0.0, speed=0.01)
    with monkeypatch.context() as patch:
        patch.setattr(worker, "_in_thread", hang)
        run.service.sleep(1.0)
        answer = run.ask("stop")
        assert answer.status_code == 502, answer.text
        assert (
            "not accepted the stop within 4 s: the driver of the gripper has not returned for"
            in answer.json()["detail"]
        )
        assert run.state_of(job)[0] == "cancelled"
        back.set()
        run.service.until(lambda: run.client.gripper.state()["connected"])
    run.service.sleep(0.5)
    assert not run.client.gripper.state()["state"]["moving"]
    assert run.toy.target_m > 0.0  # not its goal


def test_a_fault_is_one_printable_line_of_limited_length(run: Run) -> None:
    run.toy.fault = "its motor\n\x1b[31m is too hot" + 100_000 * "!"
    run.service.until(lambda: run.client.gripper.state()["state"]["fault"] != "")
    shown = run.client.gripper.state()["state"]["fault"]
    assert shown.startswith("its motor\\n\\x1b[31m is too hot!")
    assert shown.isprintable()
    assert len(shown) < 3000


def test_a_gripper_that_stalls_is_a_timeout_and_is_stopped(run: Run) -> None:
    gripper, ownership = run.service.app.state.services.gripper, run.service.app.state.services.ownership
    caller = Caller("a test", None, ownership.stops, 1.0, asyncio.Event())
    run.toy.now_s = lambda: 0.0  # its time stands
    outcome = run.service.run(gripper.run("move", GripperMove(width=0.0), caller))
    run.toy.now_s = run.service.clock.now_s
    assert isinstance(outcome.error, MotionTimeout)
    assert "move has not ended within 1 s: the fingers are still moving" in str(outcome.error)
    run.service.sleep(0.5)
    assert not run.client.gripper.state()["state"]["moving"]


def test_a_pause_of_a_gripper_job_is_rejected(run: Run) -> None:
    job = run.begin("move", width=0.0, speed=0.01)
    answer = run.service.post(f"/jobs/{job.id}/pause")
    assert answer.status_code == 409
    assert "cannot pause" in answer.json()["detail"]


def test_after_an_e_stop_only_a_release_is_taken_until_the_reset(run: Run) -> None:
    put_part(run)
    run.client.gripper.grasp(PART_M)
    run.service.app.state.services.link.request_estop()
    run.service.until(lambda: run.client.state()["mode"] == "ESTOP")
    assert run.client.gripper.state()["state"]["object"] == "held_inside"
    answer = run.ask("move", {"width": 0.1})
    assert (answer.status_code, answer.json()["code"]) == (503, "not_ready")
    assert run.ask("release").json()["success"]
    run.client.reset()


def test_a_restarted_service_finds_its_part_in_the_fingers(tmp_path: Path) -> None:
    service = VirtualService(tmp_path, of_robot=TOY % "")
    DEVICES["toy"] = ToyDevice(service.clock.now_s)
    with service.serving():
        run = Run(service)
        put_part(run)
        run.client.gripper.grasp(PART_M)
        service.until(lambda: part(run)["attached"])
    toy = DEVICES["toy"]
    again = VirtualService(tmp_path, of_robot=TOY % "", name=service.name)
    toy.now_s = again.clock.now_s
    with again.serving():
        state = Run(again).client.gripper.state()
        assert (state["held"], state["state"]["object"]) == ("part", "held_inside")
        assert (toy.width_m(), toy.target_m) == (PART_M, pytest.approx(0.033))


def test_with_on_stop_open_a_stop_opens_the_fingers(tmp_path: Path) -> None:
    for run in serve(tmp_path, ", on_stop: open"):
        run.toy.object_m = PART_M
        run.client.gripper.grasp(PART_M)
        run.service.post("/stop")
        run.service.sleep(1.0)
        assert run.toy.width_m() == STROKE_M
        assert run.client.gripper.state()["state"]["object"] == "none"


def test_without_a_gripper_each_request_says_what_to_configure(tmp_path: Path) -> None:
    for run in serve(tmp_path, keys="gripper: null"):
        with pytest.raises(NotSupportedError, match=r"set robot\.gripper in the settings"):
            run.client.gripper.state()
        with pytest.raises(NotSupportedError, match="cobot gripper list"):
            run.client.gripper.grasp()
        assert run.service.healthy()


def test_an_unknown_option_of_the_gripper_ends_the_start_with_its_name(tmp_path: Path) -> None:
    service = VirtualService(tmp_path, of_robot=TOY % ", colour: red")
    with pytest.raises(CobotError, match=r"robot\.gripper: .*colour"), service.serving():
        pass


def test_an_action_on_the_path_commands_the_gripper(run: Run) -> None:
    run.toy.object_m = PART_M
    grasp = {"at": {"fraction": 0.5}, "gripper": {"command": "grasp", "width": PART_M}}
    release = {"at": {"time_s": 0.0, "from": "end"}, "gripper": {"command": "release"}}
    joints = [0.4, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
    body = {"joints": joints, "speed": 0.2, "actions": [grasp]}
    answer = run.service.post("/robot/move/joints", body).json()
    assert answer["success"], answer
    assert [(each["fired"], each["problem"]) for each in answer["actions"]] == [(True, "")]
    run.service.until(lambda: run.client.gripper.state()["state"]["object"] == "held_inside")
    jobs = run.service.get("/jobs").json()["jobs"]
    assert [each["state"] for each in jobs if "an action on the path" in each["request"]][:1] == ["finished"]
    answer = run.service.post(
        "/robot/move/joints", {"joints": [0.0, *joints[1:]], "speed": 0.2, "actions": [release]}
    ).json()
    assert answer["success"], answer
    run.service.until(lambda: run.client.gripper.state()["state"]["object"] == "none")


@pytest.mark.parametrize(
    ("command", "status", "words"),
    [
        ({"command": "grip"}, 422, "actions[0].gripper.command: must be one of move, grasp, release"),
        ({"command": "move"}, 422, "width"),
        ({"command": "move", "width": 9.0}, 422, "width is 9 m"),
        ({"command": "move", "width": 0.04, "wide": 1}, 422, "wide"),
    ],
)
def test_a_wrong_command_on_the_path_moves_nothing(
    run: Run, command: dict[str, Any], status: int, words: str
) -> None:
    before = run.service.joints()
    action = {"at": {"fraction": 0.5}, "gripper": command}
    body = {"joints": [0.4, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0], "actions": [action]}
    answer = run.service.post("/robot/move/joints", body)
    assert answer.status_code == status, answer.text
    assert words in answer.json()["detail"]
    assert run.service.joints() == before


def test_an_action_that_the_gripper_rejects_when_it_is_due_has_not_fired(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is a failed job; the answer and an event have the reason."""
    monkeypatch.setattr(run.service.app.state.services.gripper, "_is_latched", lambda _before: True)
    joints, width = [0.4, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0], run.toy.target_m
    action = {"at": {"fraction": 0.5}, "gripper": {"command": "move", "width": 0.01}}
    answer = run.service.post("/robot/move/joints", {"joints": joints, "speed": 0.2, "actions": [action]})
    (result,) = answer.json()["actions"]
    assert not result["fired"]
    assert "remove the cause, then reset the robot" in result["problem"]
    job = next(each for each in run.service.get("/jobs").json()["jobs"] if each["kind"] == "gripper")
    assert (job["state"], job["error"]["detail"]) == ("failed", result["problem"])
    kept = run.service.app.state.events.since(0, 10_000)
    told = [json.loads(each.text)["data"] for each in kept if each.type == "action"][-1]
    assert (told["what"], told["problem"]) == ("rejected", result["problem"])
    assert run.toy.target_m == width, "the fingers were asked for nothing"


def test_a_command_on_the_path_during_an_estop_is_a_failed_job(run: Run) -> None:
    services = run.service.app.state.services

    async def begin() -> None:
        with pytest.raises(NotReadyError, match="ESTOP"):
            services.path_gripper.begin({"command": "move", "width": 0.01})

    services.link.request_estop()
    run.service.until(lambda: run.client.state()["mode"] == "ESTOP")
    run.service.run(begin())
    job = run.service.get("/jobs").json()["jobs"][0]
    run.client.reset()
    assert (job["kind"], job["state"]) == ("gripper", "failed")
    assert "ESTOP" in job["error"]["detail"]


def test_a_gripper_at_outputs_of_a_robot_without_any_is_a_problem_in_words(tmp_path: Path) -> None:
    service = VirtualService(tmp_path, of_robot="gripper: {type: digital, close_output: valve}")
    with service.serving():
        answer = service.post("/robot/gripper/release", {}).json()
        assert not answer["success"]
        words = "'valve': the robot has not reported any input or output"
        assert words in answer["message"]
        assert words in service.get("/robot/gripper").json()["problem"]
