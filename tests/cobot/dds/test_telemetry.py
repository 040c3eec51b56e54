"""Joint states written into a template against the serialiser of `rosbags`; and when what is sent."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cobot_run import unique_name
from dds_peers import own_domain
from node_rig import NodeRig
from rosbags.typesys import Stores, get_typestore

from cobot.config import Settings
from cobot.dds.telemetry import JointStateWriter, Telemetry
from cobot.ipc.shm import RobotMemory
from cobot.ipc.state_fields import state_dtype
from cobot.robot.description import RobotDescription
from cobot.robot.tool import Tool, ToolFile
from cobot.ros.messages import Messages
from cobot.ros.robot_messages import JOINT_STATES, TRANSFORMS, RobotMessages


@pytest.mark.parametrize("dof", [1, 6, 7])
@pytest.mark.parametrize("frame", ["", "b", "base_link", "iiwa/base_link"])
def test_a_template_gives_the_bytes_of_the_serialiser(dof: int, frame: str) -> None:
    random = np.random.default_rng(dof)
    store = get_typestore(Stores.ROS2_HUMBLE)
    names = [f"joint{number}" * number for number in range(1, dof + 1)]
    zeros = [0.0] * dof
    empty = {
        "header": {"frame_id": frame},
        "name": names,
        "position": zeros,
        "velocity": zeros,
        "effort": zeros,
    }
    states = JointStateWriter(Messages().to_cdr(JOINT_STATES, empty), dof)
    for _ in range(20):
        state = np.zeros((), state_dtype(dof))
        for name in ("position", "velocity", "effort"):
            state[name] = random.normal(size=dof)
        stamp_ns = int(random.integers(0, 2**31) * 1_000_000_000 + random.integers(0, 1_000_000_000))
        content = states.cdr(state, stamp_ns)
        read = store.deserialize_cdr(content, JOINT_STATES)
        assert (read.header.stamp.sec, read.header.stamp.nanosec) == divmod(stamp_ns, 1_000_000_000)
        assert (read.header.frame_id, read.name) == (frame, names)
        for name in ("position", "velocity", "effort"):
            assert np.array_equal(getattr(read, name), state[name])
        assert bytes(store.serialize_cdr(read, JOINT_STATES)) == content


class Silent:
    """Shared memory of a robot in which the test is rtloop, and the telemetry of it, not begun."""

    def __init__(self, settings: Settings, rig: NodeRig) -> None:
        section = settings.robot.model_copy(update={"name": unique_name()})
        self.settings = settings.model_copy(update={"robot": section})
        limits = 7
        self.memory = RobotMemory.create(section.name, limits, 0.001, 100)
        transforms = rig.do(lambda: rig.node.publisher("/tf", "tf2_msgs/msg/TFMessage"))
        self.telemetry = rig.do(lambda: Telemetry(rig.node, self.settings, "", transforms))

    def measure(self, ago_s: float = 0.0) -> int:
        now_ns = time.monotonic_ns() - int(ago_s * 1e9)
        self.memory.state.data["monotonic_ns"] = self.memory.state.data["measured_monotonic_ns"] = now_ns
        self.memory.state.data["tcp"] = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
        self.memory.state.publish()
        return now_ns


@pytest.fixture
def silent(settings: Settings) -> Iterator[Silent]:
    with own_domain() as domain, NodeRig(domain) as rig:
        made = Silent(settings, rig)
        yield made
        made.memory.unlink()
        made.memory.close()


def test_a_state_is_fresh_or_the_reason_is_known(silent: Silent) -> None:
    telemetry = silent.telemetry
    assert telemetry.read() is None
    assert telemetry.problem == "rtloop has not started yet"
    silent.measure()
    assert telemetry.read() is not None
    silent.measure(ago_s=1.0)
    assert telemetry.read() is None
    assert telemetry.problem.startswith("rtloop has published nothing for 1.")
    silent.measure()
    silent.memory.state.data["measured_monotonic_ns"] -= 1_000_000_000
    silent.memory.state.publish()
    assert telemetry.read() is None
    assert telemetry.problem.startswith("rtloop has measured nothing for 1.")


def test_a_measurement_is_sent_once(silent: Silent) -> None:
    feed = silent.telemetry.joint_states
    sent: list[int] = []
    feed.make = lambda state: bytes(sent.append(int(state["measured_monotonic_ns"])) or 4)
    measured = [silent.measure() for _ in range(2)]
    for _ in range(3):
        silent.telemetry.publish(feed, silent.telemetry.read(), time.monotonic_ns())
    measured.append(silent.measure())
    silent.telemetry.publish(feed, silent.telemetry.read(), time.monotonic_ns())
    assert sent == measured[1:]


def test_stamps_follow_the_measurements_while_messages_are_first_made(
    silent: Silent, monkeypatch: pytest.MonkeyPatch
) -> None:
    telemetry, store = silent.telemetry, get_typestore(Stores.ROS2_HUMBLE)
    encode = telemetry._encode

    def encode_slowly(type_: str, content: dict[str, object]) -> bytes:
        time.sleep(0.02)  # five periods of joint states at 250 Hz
        return encode(type_, content)

    monkeypatch.setattr(telemetry, "_encode", encode_slowly)
    measured, stamps = [], []
    for _ in range(3):
        measured.append(silent.measure())
        message = telemetry.joint_states.make(silent.memory.state.read())
        stamp = store.deserialize_cdr(message, JOINT_STATES).header.stamp
        stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
    assert np.diff(stamps) == pytest.approx(np.diff(measured), abs=100_000)


def test_the_tcp_is_that_of_the_tool_that_rtloop_carries(settings: Settings, tmp_path: Path) -> None:
    kept = settings.model_copy(update={"logs": tmp_path})
    with own_domain() as domain, NodeRig(domain) as rig:
        silent = Silent(kept, rig)
        telemetry, told = silent.telemetry, []
        telemetry.on_tool = lambda: told.append(telemetry.static_transforms[-1])
        before = telemetry.static_transforms[-1]["transform"]["translation"]["z"]
        tool = Tool(version=4, tcp=(0.0, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0))
        ToolFile(silent.settings.tool_file).write(tool)
        telemetry._follow_tool(3)  # another one than is kept: it will be kept, or changed back
        assert told == []
        telemetry._follow_tool(4)
        telemetry._follow_tool(4)
        (transform,) = told
        assert transform["child_frame_id"] == "tcp"
        assert transform["transform"]["translation"]["z"] == pytest.approx(before + 0.2)
        again = rig.do(
            lambda: Telemetry(rig.node, silent.settings, "", rig.node.publisher("/tf", TRANSFORMS))
        )
        assert again.static_transforms[-1]["transform"] == transform["transform"]
        silent.memory.unlink()
        silent.memory.close()


def test_the_grid_of_a_rate_is_kept_until_it_is_left(silent: Silent) -> None:
    feed = silent.telemetry.joint_states
    feed.rate_hz = 100.0
    feed.due_ns = 1_000_000_000
    feed.advance(1_000_400_000)
    assert feed.due_ns == 1_010_000_000
    feed.advance(1_500_000_000)
    assert feed.due_ns == 1_510_000_000


def test_a_robot_that_does_not_run_is_no_error(settings: Settings) -> None:
    with own_domain() as domain, NodeRig(domain) as rig:
        silent = Silent(settings, rig)
        silent.memory.unlink()
        silent.memory.close()
        assert silent.telemetry.read() is None
        assert "is not running" in silent.telemetry.problem


def test_joint_states_of_the_template_are_those_of_the_hub(
    settings: Settings, robot: RobotDescription
) -> None:
    made = RobotMessages(robot.model, settings.robot.base_frame, settings.robot.tcp)
    state = np.zeros((), state_dtype(7))
    state["position"] = np.linspace(-1.0, 1.0, 7)
    state["measured_monotonic_ns"] = time.monotonic_ns()
    messages = Messages()
    template = JointStateWriter(
        messages.to_cdr(JOINT_STATES, made.joint_state(np.zeros((), state_dtype(7)))), 7
    )
    ours = messages.from_cdr(JOINT_STATES, template.cdr(state, 5))
    graphs = made.joint_state(state)
    assert ours["header"]["frame_id"] == graphs["header"]["frame_id"]
    assert {key: ours[key] for key in ("name", "position", "velocity", "effort")} == {
        key: graphs[key] for key in ("name", "position", "velocity", "effort")
    }
