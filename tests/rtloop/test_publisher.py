"""What rtloop publishes. Oracles: the values that were given; MuJoCo; the filter's law in numpy; bincount."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from cobot_run import unique_name
from rig import Rig
from sample_counts import samples

import rtloop.publisher
from cobot.config import Settings
from cobot.errors import LayoutError
from cobot.grippers import GripperState, HeldObject
from cobot.ipc.gripper_record import fill_gripper
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Command, GripperObject, Intervention, Phase, text
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.state_fields import STATE_SCALARS
from cobot.reasons import Reason
from cobot.robot.description import RobotDescription
from rtloop.backends import Measured
from rtloop.publisher import EFFORT_RATE_S, STATISTICS_CYCLES, StatePublisher, Statistics

CYCLES = samples(100_000)
COMPARED = 1000
PERIOD_S = 1e-3
SCALARS = np.dtype(list(STATE_SCALARS))


@pytest.fixture
def memories(robot: RobotDescription) -> Iterator[list[RobotMemory]]:
    """One for rtloop, one for a reader."""
    name = unique_name()
    memories = [RobotMemory.create(name, robot.limits.dof, PERIOD_S, 2)]
    memories.append(RobotMemory.attach(name, MemoryRole.READER))
    yield memories
    memories[0].unlink()
    for memory in memories:
        memory.close()


def publisher_of(memory: RobotMemory, robot: RobotDescription) -> StatePublisher:
    return StatePublisher(memory, robot.model)


def test_every_value_arrives_in_its_place(memories: list[RobotMemory], robot: RobotDescription) -> None:
    random = np.random.default_rng(31)
    publisher = publisher_of(memories[0], robot)
    for _ in range(samples(1000)):
        scalars = np.frombuffer(random.bytes(SCALARS.itemsize), SCALARS).reshape(()).copy()
        measured = Measured(robot.limits.dof)
        measured.values[:] = random.normal(size=measured.values.shape)
        command = random.normal(size=(3, robot.limits.dof))
        before_ns = time.monotonic_ns()
        publisher.publish_values(scalars, measured.values, command)
        state = memories[1].state.read()
        assert before_ns <= state["monotonic_ns"] <= time.monotonic_ns()
        scalars["monotonic_ns"] = state["monotonic_ns"]
        assert state.tobytes()[: SCALARS.itemsize] == scalars.tobytes()
        for name in ("position", "velocity", "effort", "desired_effort", "external_effort"):
            np.testing.assert_array_equal(state[name], getattr(measured, name))
        np.testing.assert_array_equal(state["wrench"], measured.wrench)
        np.testing.assert_array_equal(state["sensor"], measured.sensor)
        for name, row in zip(("position", "velocity", "acceleration"), command, strict=True):
            np.testing.assert_array_equal(state[f"commanded_{name}"], row)


def test_reason_and_interventions_are_those_of_this_cycle(
    settings: Settings, robot: RobotDescription
) -> None:
    rig = Rig(settings, robot)
    reader = RobotMemory.attach(rig.memory.robot, MemoryRole.READER)
    try:
        reasons, codes = set(), set()
        for cycle in range(200):
            if cycle in (20, 120):
                rig.request("estops" if cycle == 20 else "stops")
            if cycle in (60, 160):
                rig.send(Command.RESET)
            rig.loopback.offset[:] = 0.5 if 100 <= cycle < 150 else 0.0
            rig.step()
            state = reader.state.read()
            reasons.add(rig.reason)
            assert text(state["reason"]) == rig.reason
            assert Reason.of_record(state).fields() == rig.reason.fields()
            codes.add(rig.reason.code)
            assert state["interventions"].tolist() == rig.interventions
            assert (state["intervened_ns"] > 0).tolist() == (state["interventions"] > 0).tolist()
        assert len(reasons) == 3, "none, the e-stop, what is wrong with the tracking"
        assert codes == {"", "estop_requested", "tracking"}
        assert rig.interventions[Intervention.TRACKING] == 1
    finally:
        reader.close()
        rig.close()


def test_tcp_and_effort_rate_are_those_of_the_plain_laws(
    memories: list[RobotMemory], robot: RobotDescription
) -> None:
    random = np.random.default_rng(32)
    dof, limits = robot.limits.dof, robot.limits
    values = random.normal(size=(CYCLES, Measured(dof).values.size)) * 3.0
    values[:, :dof] = random.uniform(limits.min_position, limits.max_position, (CYCLES, dof))
    publisher, scalars, command = publisher_of(memories[0], robot), np.zeros((), SCALARS), np.zeros((3, dof))
    rates, state = np.empty((CYCLES, dof)), memories[0].state.data
    tcp = np.empty(7)
    for cycle, measured in enumerate(values):
        publisher.publish_values(scalars, measured, command)
        rates[cycle] = state["effort_rate"]
        if cycle % (CYCLES // COMPARED) == 0:
            robot.model.forward_into(measured[:dof], tcp)
            velocity = robot.model.jacobian(measured[:dof]) @ measured[dof : 2 * dof]
            np.testing.assert_allclose(state["tcp"], tcp, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(state["tcp_velocity"], velocity, rtol=1e-12, atol=1e-11)
    efforts = values[:, 2 * dof : 3 * dof]
    expected, rate = np.empty((CYCLES, dof)), np.zeros(dof)
    changes = np.diff(efforts, axis=0, prepend=np.zeros((1, dof))) / PERIOD_S
    for cycle in range(CYCLES):
        rate = rate + (changes[cycle] - rate) * (PERIOD_S / EFFORT_RATE_S)
        expected[cycle] = rate
    np.testing.assert_allclose(rates, expected, rtol=1e-12, atol=1e-9)  # of some 1e3 N·m/s


def test_histograms_are_those_of_numpy(memories: list[RobotMemory]) -> None:
    random = np.random.default_rng(33)
    statistics = Statistics(memories[0])
    durations_ns = np.exp(random.uniform(0.0, 17.0, (CYCLES, len(Phase)))).astype(np.int64)
    for row in durations_ns.tolist():
        for phase in Phase:
            statistics.count(phase, row[phase])
        statistics.end_cycle()
    published = memories[1].statistics.read()
    assert CYCLES % STATISTICS_CYCLES == 0
    assert published["cycles"] == CYCLES
    buckets = np.minimum(durations_ns // 1000, HISTOGRAM_BUCKETS - 1)
    for phase in Phase:
        expected = np.bincount(buckets[:, phase], minlength=HISTOGRAM_BUCKETS)
        np.testing.assert_array_equal(published["histogram"][phase], expected)
        assert published["max_us"][phase] == (durations_ns[:, phase] // 1000).max()


def test_a_sample_of_no_phase_is_not_counted_anywhere(memories: list[RobotMemory]) -> None:
    statistics = Statistics(memories[0])
    for phase in (-1, len(Phase), 2**31 - 1, -(2**31)):
        statistics.count(phase, 1000)
    statistics.count(Phase.READ, 2**63 - 1)
    statistics.count(Phase.READ, -(2**63))
    histogram = memories[0].statistics.data["histogram"]
    assert histogram.sum() == histogram[Phase.READ, -1] == 2


@pytest.mark.parametrize("fault", ["swapped", "another kind", "one more"])
def test_a_publisher_does_not_start_with_another_layout_than_that_of_the_state(
    monkeypatch: pytest.MonkeyPatch, memories: list[RobotMemory], robot: RobotDescription, fault: str
) -> None:
    scalars = list(STATE_SCALARS)
    match fault:
        case "swapped":
            scalars[4], scalars[5] = scalars[5], scalars[4]
        case "another kind":
            scalars[1] = scalars[1][0], "u8"
        case "one more":
            scalars.append(("one_more", "u8"))
    monkeypatch.setattr(rtloop.publisher, "STATE_SCALARS", tuple(scalars))
    with pytest.raises(LayoutError, match="scalars"):
        publisher_of(memories[0], robot)


def published(rig: Rig) -> np.ndarray:
    reader = RobotMemory.attach(rig.memory.robot, MemoryRole.READER)
    try:
        return np.array(reader.state.read())
    finally:
        reader.close()


def test_a_reading_of_the_gripper_is_in_the_state_of_the_next_cycle(rig: Rig) -> None:
    """Also after its service has died while it wrote the next one. Oracle: the values that were given."""
    rig.step(2)
    state = published(rig)
    assert state["gripper_object"] == GripperObject.ABSENT
    assert np.isnan(
        [state[name] for name in ("gripper_width", "gripper_commanded_width", "gripper_force")]
    ).all()
    fill_gripper(
        rig.memory.gripper.data,
        GripperState(0.04, 0.03, moving=True, force=None, object=HeldObject.HELD_INSIDE),
        5,
    )
    rig.memory.gripper.publish()
    rig.step(1)
    expected = rig.memory.gripper.data.copy()
    for sequence in (None, 7):
        if sequence is not None:
            rig.memory.gripper._head[0] = sequence  # odd: a write that never ends
            rig.step(3)
        state = published(rig)
        for name in expected.dtype.names:
            np.testing.assert_array_equal(state[name], expected[name])


def test_an_object_that_no_enumeration_has_is_unknown(rig: Rig) -> None:
    rig.memory.gripper.data["gripper_object"] = 77
    rig.memory.gripper.publish()
    rig.step(1)
    assert published(rig)["gripper_object"] == GripperObject.UNKNOWN


def test_the_objects_of_the_state_are_those_of_grippers() -> None:
    assert [kind.name for kind in GripperObject][2:] == [kind.name for kind in HeldObject]
    assert [kind.is_held for kind in GripperObject][2:] == [kind.is_held for kind in HeldObject]
