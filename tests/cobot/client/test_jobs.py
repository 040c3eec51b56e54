"""Motions that the Python client does not wait for.

Oracles: a service on virtual time; the paths that docs/jobs.md names.
"""

from __future__ import annotations

import httpx2
import numpy as np
import pytest
from virtual_service import VirtualService

from cobot.client import Client, JobHandle
from cobot.errors import (
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
    MotionTimeout,
    NotFoundError,
)

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.5, *HOME[1:]]


@pytest.fixture(params=["", "/robots/{name}"])
def robot(service: VirtualService, request: pytest.FixtureRequest) -> Client:
    """The default robot, and the same one by its name."""
    service.go_home()
    return service.client(service.url + request.param.format(name=service.name))


def moving(robot: Client) -> JobHandle:
    handle = robot.move_joints([1.5, *HOME[1:]], speed=0.1, wait=False)
    assert handle.read(0.5)["progress"] > 0.0
    return handle


def test_a_motion_goes_on_while_the_program_does(robot: Client) -> None:
    handle = robot.move_joints(AWAY, speed=0.5, wait=False)
    assert handle.state == "planning"
    with pytest.raises(ConflictError, match="in use by"):
        robot.move_joints(HOME)
    assert handle.wait()["state"] == "finished"
    np.testing.assert_allclose(robot.joint_states()["position"], AWAY, atol=1e-3)
    assert robot.jobs(1)[0]["id"] == handle.id
    assert robot.job(handle.id).state == "finished"


def test_a_handle_pauses_resumes_and_cancels(robot: Client) -> None:
    handle = moving(robot)
    assert handle.pause()["state"] == "paused"
    assert robot.jobs(5, "paused")[0]["id"] == handle.id
    assert handle.resume()["state"] == "running"
    assert robot.set_speed_override(0.5) == robot.speed_override() == 0.5
    assert handle.cancel()["state"] == "cancelled"
    robot.set_speed_override(1.0)
    with pytest.raises(MotionStopped, match=f"job {handle.id} was cancelled"):
        handle.wait()


def test_motions_are_queued_and_the_arm_is_free_after_the_last(robot: Client) -> None:
    arc = {"centre": {"x": 0.5, "y": 0.0, "z": 0.5}, "axis": {"x": 0.0, "y": 0.0, "z": 1.0}, "angle": 0.1}
    pose = {"x": 0.45, "y": 0.0, "z": 0.5, "b": 3.14159, "speed": 1.0}
    handles = [
        robot.queue({"joints": AWAY, "speed": 0.5}, blend_radius=0.05),
        robot.queue(pose),
        robot.queue({**arc, "speed": 1.0}),
        robot.queue({"motions": [{"name": "home", "speed": 1.0}, {"joints": AWAY, "speed": 1.0}]}),
        robot.queue({"name": "home", "speed": 1.0}),
    ]
    plan = robot.plan("joints", joints=AWAY, speed=1.0, start=HOME)
    handles.append(robot.queue({"plan_id": plan["plan_id"]}))
    assert handles[-1].state == "queued"
    assert handles[-1].wait()["kind"] == "execute"
    assert robot.move_named("home", speed=1.0)["success"]
    assert [handle.state for handle in handles] == ["finished"] * 6


def test_a_wait_has_an_end(robot: Client) -> None:
    handle = moving(robot)
    with pytest.raises(MotionTimeout, match=f"job {handle.id} is running after 0 s"):
        handle.wait(0.0)
    robot.stop()


def test_each_motion_can_be_left_to_itself(robot: Client) -> None:
    arc = {"centre": {"x": 0.5, "y": 0.0, "z": 0.6}, "axis": {"x": 0.0, "y": 0.0, "z": 1.0}}
    robot.move_named("home", speed=1.0, wait=False).wait()
    robot.move_pose(x=0.45, y=0.0, z=0.5, b=3.14159, speed=1.0, wait=False).wait()
    robot.move_arc(**arc, angle=0.1, speed=1.0, wait=False).wait()
    robot.move_sequence([{"joints": AWAY, "speed": 1.0}, {"joints": HOME, "speed": 1.0}], wait=False).wait()
    plan = robot.plan("joints", joints=AWAY, speed=1.0)
    assert robot.execute(plan["plan_id"], wait=False).wait()["kind"] == "execute"


def test_what_cannot_be_begun_or_found_is_raised(robot: Client) -> None:
    with pytest.raises(InputError, match="nowhere"):
        robot.move_named("nowhere", wait=False)
    with pytest.raises(NotFoundError, match="there is no job"):
        robot.job("nothing").cancel()


def test_an_interrupted_job_is_an_error_of_its_execution() -> None:
    lost = {"id": "7", "state": "interrupted", "error": {"detail": "gone", "code": "interrupted"}}
    transport = httpx2.MockTransport(lambda request: httpx2.Response(200, json=lost))
    with (
        Client("http://robot.test", transport=transport) as robot,
        pytest.raises(ExecutionError, match="gone"),
    ):
        robot.job("7").wait()


def test_waypoints_are_named_in_the_query() -> None:
    asked: list[str] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        asked.append(request.url.raw_path.decode())
        return httpx2.Response(200, json={"state": "paused"})

    with Client("http://robot.test", transport=httpx2.MockTransport(answer)) as robot:
        handle = robot.job("7")
        for tell in (handle.pause, handle.step, handle.resume):
            tell()
        handle.pause(at_waypoint=0)
        handle.resume(waypoint=3)
    words = ["pause", "step", "resume", "pause?at_waypoint=0", "resume?waypoint=3"]
    assert asked == [f"/jobs/7/{word}" for word in words]
