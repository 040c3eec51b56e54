"""What rtloop publishes. Oracles: the values that were given; MuJoCo; the filter's law in numpy; bincount."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from running import unique_name

import rtloop.publisher
from cobot.errors import LayoutError
from cobot.ipc.layout import HISTOGRAM_BUCKETS, STATE_SCALARS, Intervention, Phase
from cobot.ipc.shm import RobotMemory, Role, text
from cobot.robot.description import RobotDescription
from rtloop.backends import Measured
from rtloop.publisher import EFFORT_RATE_S, STATISTICS_CYCLES, StatePublisher, Statistics

CYCLES = 100_000
COMPARED = 1000
PERIOD_S = 1e-3


@pytest.fixture
def memories(robot: RobotDescription) -> Iterator[list[RobotMemory]]:
    """One for rtloop, one for a reader."""
    name = unique_name()
    memories = [RobotMemory.create(name, robot.limits.dof, PERIOD_S, 2)]
    memories.append(RobotMemory.attach(name, Role.READER))
    yield memories
    memories[0].unlink()
    for memory in memories:
        memory.close()


class Core:
    """What a publisher asks of a controller and its parts."""

    def __init__(self, dof: int) -> None:
        self.mode, self.settled, self.motion_id, self.motion_result, self.slot = 1, True, 3, 4, 5
        self.clock = SimpleNamespace(path_time_s=0.25, rate=0.75)
        self.path = SimpleNamespace(duration_s=1.25)
        self.deceleration_ns = 10
        self.commands = SimpleNamespace(stops=11, estops=12, command_seen=2**64 - 1, torn_reads=20)
        self.streaming = SimpleNamespace(
            session=14,
            setpoint_seen=15,
            move_seen=16,
            move_running=True,
            chunk_seen=18,
            point_counts=(19, 20, 21, 22, 23),
            torn_reads=5,
        )
        self.safety = SimpleNamespace(
            command=np.zeros((3, dof)),
            interventions=np.zeros(len(Intervention), np.uint64),
            intervened_ns=np.zeros(len(Intervention), np.int64),
            counted=0,
        )
        self.reason = ""


EXPECTED = {
    "cycle": 7, "robot_time_s": 0.5, "mode": 1, "settled": 1, "motion_id": 3, "motion_result": 4, "slot": 5,
    "path_time_s": 0.25, "path_duration_s": 1.25, "path_rate": 0.75, "deceleration_monotonic_ns": 10,
    "stops_seen": 11, "estops_seen": 12, "command_seen": 2**64 - 1, "session": 14, "setpoint_seen": 15,
    "move_seen": 16, "move_running": 1, "chunk_seen": 18, "point_seen": 19, "points_taken": 20,
    "points_dropped": 21, "points_buffered": 22, "underruns": 23, "overruns": 24, "torn_reads": 25,
    "measured_monotonic_ns": 26,
}  # fmt: skip


def test_every_scalar_arrives_in_its_place(memories: list[RobotMemory], robot: RobotDescription) -> None:
    core, measured = Core(robot.limits.dof), Measured(robot.limits.dof)
    random = np.random.default_rng(31)
    measured.values[:] = random.normal(size=measured.values.shape)
    core.safety.command[:] = random.normal(size=core.safety.command.shape)
    publisher = StatePublisher(memories[0], robot.model, core, SimpleNamespace(overruns=24))
    publisher.publish(7, 0.5, measured, 26)
    state = memories[1].state.read()
    assert {name for name, _ in STATE_SCALARS} == {*EXPECTED, "monotonic_ns"}
    assert {name: state[name].item() for name in EXPECTED} == EXPECTED
    for name in ("position", "velocity", "effort", "desired_effort", "external_effort", "wrench", "sensor"):
        np.testing.assert_array_equal(state[name], getattr(measured, name))
    for name, row in zip(("position", "velocity", "acceleration"), core.safety.command, strict=True):
        np.testing.assert_array_equal(state[f"commanded_{name}"], row)


def test_reason_and_interventions_are_those_of_the_last_change(
    memories: list[RobotMemory], robot: RobotDescription
) -> None:
    core, measured = Core(robot.limits.dof), Measured(robot.limits.dof)
    publisher = StatePublisher(memories[0], robot.model, core, SimpleNamespace(overruns=0))
    for number, reason in enumerate(("", "stop requested", "é" * 200, "é" * 200, "")):
        core.reason = reason
        core.safety.interventions += np.uint64(number)
        core.safety.intervened_ns[:] = -number
        core.safety.counted += number
        publisher.publish(number, 0.0, measured, 0)
        state = memories[1].state.read()
        assert text(state["reason"]) == reason[:100]
        np.testing.assert_array_equal(state["interventions"], core.safety.interventions)
        np.testing.assert_array_equal(state["intervened_ns"], core.safety.intervened_ns)


def test_tcp_and_effort_rate_are_those_of_the_plain_laws(
    memories: list[RobotMemory], robot: RobotDescription
) -> None:
    random = np.random.default_rng(32)
    dof, limits = robot.limits.dof, robot.limits
    positions = random.uniform(limits.min_position, limits.max_position, (CYCLES, dof))
    velocities, efforts = random.normal(size=(2, CYCLES, dof)) * 3.0
    core, measured = Core(dof), Measured(dof)
    publisher = StatePublisher(memories[0], robot.model, core, SimpleNamespace(overruns=0))
    rates, state = np.empty((CYCLES, dof)), memories[0].state.data
    tcp, velocity = np.empty(7), np.empty(6)
    for cycle in range(CYCLES):
        measured.position[:], measured.velocity[:] = positions[cycle], velocities[cycle]
        measured.effort[:] = efforts[cycle]
        publisher.publish(cycle, 0.0, measured, 0)
        rates[cycle] = state["effort_rate"]
        if cycle % (CYCLES // COMPARED) == 0:
            robot.model.forward_into(positions[cycle], tcp)
            robot.model.velocity_into(velocities[cycle], velocity)
            np.testing.assert_allclose(state["tcp"], tcp, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(state["tcp_velocity"], velocity, rtol=1e-12, atol=1e-11)
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
        statistics.cycle_done()
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
        StatePublisher(memories[0], robot.model, Core(robot.limits.dof), SimpleNamespace(overruns=0))
