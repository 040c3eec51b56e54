"""A link of the simulated arm is pulled over the WebSocket while it is guided by hand, on virtual time.

Oracles: MuJoCo's qfrc_applied, its Jacobian, and the effort limits of joint_limits.yaml; the state by REST.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from independent_models import MJCF
from streaming_client import Frames
from virtual_service import VirtualService

from cobot.ipc.device_record import fill_capabilities
from cobot.types import Array
from rtloop.backends.mujoco import MujocoBackend

PATH = "/robot/freedrive"
EVERY_S = 0.05
POINT = [0.0, 0.0, 0.03]
SIDEWAYS = np.array([0.0, 0.3, 0.0])
MAX_PULL_N, MAX_SHARE = 50.0, 0.15


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    service.go_home()
    service.sleep(1.0)
    service.post(PATH, {"timeout_s": 60.0}).raise_for_status()
    yield service
    service.ask("DELETE", PATH).raise_for_status()
    service.sleep(0.5)
    service.post("/robot/reset", {}).raise_for_status()


@pytest.fixture
def client(run: VirtualService) -> Iterator[Frames]:
    with Frames(run.connect("/robot/stream")) as connected:
        yield connected


def tcp(run: VirtualService) -> Array:
    position = run.get("/robot/pose").json()["position"]
    return np.array([position[axis] for axis in "xyz"])


def efforts(run: VirtualService) -> Array:
    return np.array(run.rig.simulation._data.qfrc_applied)


def pull(
    run: VirtualService, client: Frames, seconds: float, target: Array, link: str = "link7"
) -> list[Array]:
    """As a mouse does, whose button is held; what it exerts on the joints."""
    found = []
    for _ in range(round(seconds / EVERY_S)):
        client.send("pull", link=link, point=POINT, target=target.tolist())
        assert client.answer() == {"type": "pull", "link": link}
        run.sleep(EVERY_S)
        found.append(efforts(run))
    return found


def refused(client: Frames, **frame: Any) -> dict[str, Any]:
    client.send("pull", **frame)
    answer = client.answer()
    assert (answer["type"], answer["about"]) == ("error", "pull"), answer
    return answer


def test_the_arm_follows_a_bounded_pull_and_rests_when_it_is_let_go(
    run: VirtualService, client: Frames
) -> None:
    before = tcp(run)
    far = before + np.array([0.0, 2.0, 0.0])
    felt = pull(run, client, 2.0, far)
    limits = run.rig.robot.limits
    assert all((np.abs(each) <= MAX_SHARE * limits.max_effort + 1e-9).all() for each in felt)
    model = mujoco.MjModel.from_xml_path(str(MJCF))
    data = mujoco.MjData(model)
    data.qpos[:] = run.rig.simulation._data.qpos
    mujoco.mj_forward(model, data)
    jacobian, body = np.zeros((3, model.nv)), model.body("link7").id
    point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ POINT
    mujoco.mj_jac(model, data, jacobian, None, point, body)
    force = np.linalg.lstsq(jacobian.T, felt[-1], rcond=None)[0]
    np.testing.assert_allclose(jacobian.T @ force, felt[-1], atol=0.2, err_msg="a force at that point")
    assert np.linalg.norm(force) <= MAX_PULL_N + 0.5
    assert force @ (far - point) > 0.95 * np.linalg.norm(force) * np.linalg.norm(far - point), "towards it"
    assert tcp(run)[1] - before[1] > 0.05
    client.send("pull")
    run.sleep(0.1)
    np.testing.assert_array_equal(efforts(run), 0.0)
    run.sleep(1.0)
    rests = tcp(run)
    run.sleep(2.0)
    np.testing.assert_allclose(tcp(run), rests, atol=2e-3, err_msg="and leaves no trace")


def test_silence_ends_a_pull(run: VirtualService, client: Frames) -> None:
    pull(run, client, 0.2, tcp(run) + SIDEWAYS)
    assert np.abs(efforts(run)).max() > 1.0
    run.sleep(0.2 + 0.05)
    np.testing.assert_array_equal(efforts(run), 0.0)


def test_a_lost_connection_ends_a_pull(run: VirtualService) -> None:
    with Frames(run.connect("/robot/stream")) as client:
        pull(run, client, 0.2, tcp(run) + SIDEWAYS)
        assert np.abs(efforts(run)).max() > 1.0
    run.sleep(0.05)
    np.testing.assert_array_equal(efforts(run), 0.0)


@pytest.mark.parametrize("end", ["stop", "fast stop", "off"])
def test_a_stop_and_the_end_of_hand_guiding_end_a_pull(run: VirtualService, client: Frames, end: str) -> None:
    pull(run, client, 0.3, tcp(run) + SIDEWAYS)
    assert np.abs(efforts(run)).max() > 1.0
    if end == "off":
        run.ask("DELETE", PATH).raise_for_status()
    else:
        run.post("/stop?category=1" if end == "fast stop" else "/stop", {}).raise_for_status()
    run.sleep(0.25)
    np.testing.assert_array_equal(efforts(run), 0.0)
    detail = refused(client, link="link7", point=POINT, target=[0.4, 0.3, 0.6])["detail"]
    assert detail.startswith("hand guiding is off")
    run.sleep(0.1)
    np.testing.assert_array_equal(efforts(run), 0.0)


def test_what_cannot_be_pulled_is_refused_by_name(run: VirtualService, client: Frames) -> None:
    target = [0.4, 0.3, 0.6]
    for link in ("base_link", "nowhere"):
        detail = refused(client, link=link, point=POINT, target=target)["detail"]
        assert f"there is no link {link!r} that moves; valid names: link1, link2" in detail
    assert "must be given together" in refused(client, link="link7", target=target)["detail"]
    block = run.rig.memory.device
    try:
        fill_capabilities(block.data, replace(MujocoBackend.capabilities, hardware=True))
        block.publish()
        answer = refused(client, link="link7", point=POINT, target=target)
        reset = run.post("/robot/simulation/reset", {})
    finally:
        fill_capabilities(block.data, MujocoBackend.capabilities)
        block.publish()
    assert (answer["code"], reset.status_code) == ("not_supported", 501)
    assert "the backend mujoco moves a real arm" in answer["detail"]
    assert "the backend mujoco moves a real arm" in reset.json()["detail"]
    np.testing.assert_array_equal(efforts(run), 0.0)


def test_a_pull_ends_without_the_service_and_needs_an_impedance(run: VirtualService) -> None:
    """The simulation alone, as if nothing reached it any more."""
    simulation = run.rig.simulation
    simulation.pull("link7", np.array(POINT), np.array([0.4, 1.0, 0.6]))
    run.sleep(0.1)
    assert np.abs(efforts(run)).max() > 1.0
    run.sleep(0.11)
    np.testing.assert_array_equal(efforts(run), 0.0)
    run.ask("DELETE", PATH).raise_for_status()
    run.sleep(0.5)
    simulation.pull("link7", np.array(POINT), np.array([0.4, 1.0, 0.6]))
    run.sleep(0.05)
    np.testing.assert_array_equal(efforts(run), 0.0)


def test_the_simulation_begins_again(run: VirtualService) -> None:
    run.ask("DELETE", PATH).raise_for_status()
    start = run.joints()
    assert run.post("/robot/move/joints", {"joints": [0.5, *start[1:]], "speed": 1.0}).json()["success"]
    run.post("/stop?category=1", {}).raise_for_status()
    assert run.health()["robot"]["mode"] == "ESTOP"
    run.post("/robot/simulation/reset", {}).raise_for_status()
    run.sleep(0.1)
    assert run.health()["robot"]["mode"] == "HOLD"
    np.testing.assert_allclose(run.joints(), start, atol=1e-3)
    run.sleep(1.0)
    np.testing.assert_allclose(run.joints(), start, atol=1e-3, err_msg="it is held there")
    commanded = run.get("/robot/state").json()["commanded_position"]
    np.testing.assert_allclose(commanded, start, atol=1e-3)
    assert run.post("/robot/move/joints", {"joints": [0.1, *start[1:]], "speed": 1.0}).json()["success"]


def test_a_simulation_that_moves_is_not_begun_again(run: VirtualService) -> None:
    answer = run.post("/robot/simulation/reset", {})
    assert answer.status_code == 409
    assert "the robot is in use by POST /robot/freedrive" in answer.json()["detail"]
