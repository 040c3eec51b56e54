"""What the cycle and a compiled backend share: the measured values, and which way they are read and written.

Oracle: the Python methods `read` and `write`, which say why when something fails.
"""

from __future__ import annotations

import numpy as np
import pytest

from cobot.config import Settings
from cobot.errors import InputError
from cobot.robot.description import RobotDescription
from rtloop.backends import BackendError, Impedance, Measured
from rtloop.backends.compiled import CompiledBackend
from rtloop.backends.mujoco import MujocoBackend

PARTS = ("position", "velocity", "effort", "desired_effort", "external_effort", "wrench", "sensor")


@pytest.fixture
def backend(settings: Settings, robot: RobotDescription) -> MujocoBackend:
    return opened(MujocoBackend, settings, robot)


def opened(kind: type[MujocoBackend], settings: Settings, robot: RobotDescription) -> MujocoBackend:
    made = kind(settings, robot.limits)
    made.open(np.array(robot.positions["home"].joints))
    return made


def command_at_home(robot: RobotDescription) -> np.ndarray:
    command = np.zeros((3, robot.limits.dof))
    command[0] = robot.positions["home"].joints
    return command


def test_the_parts_of_what_is_measured_are_one_buffer_in_their_order() -> None:
    measured = Measured(7)
    measured.values[:] = np.arange(47.0)
    np.testing.assert_array_equal(
        np.concatenate([getattr(measured, part) for part in PARTS]), measured.values
    )
    np.testing.assert_array_equal(measured.joints.ravel(), measured.values[:35])
    np.testing.assert_array_equal(measured.external, measured.values[28:41])


@pytest.mark.parametrize("given", [[0.3], 0.3, np.zeros(6), np.zeros((1, 7)), "abc"])
def test_a_shape_that_is_not_the_arms_is_refused(given: object) -> None:
    measured = Measured(7)
    with pytest.raises(ValueError, match=r"measured.position is given the shape \(.*\), expected \(7,\)"):
        measured.position = given
    assert not measured.values.any()


@pytest.mark.parametrize("part", [*PARTS, "joints", "external", "values"])
def test_what_is_assigned_to_a_part_goes_into_the_buffer(part: str) -> None:
    measured = Measured(7)
    before = getattr(measured, part)
    setattr(measured, part, np.full_like(before, 2.0))
    assert getattr(measured, part) is before
    assert measured.values.sum() == 2.0 * before.size


def test_an_offset_is_added_in_the_buffer() -> None:
    measured = Measured(7)
    measured.position += 1.0
    np.testing.assert_array_equal(measured.values, [1.0] * 7 + [0.0] * 40)


def test_nothing_else_can_be_assigned() -> None:
    with pytest.raises(AttributeError):
        Measured(7).torque = np.zeros(7)  # type: ignore[attr-defined]


def test_more_joints_than_there_is_room_for_are_refused() -> None:
    assert Measured(16).values.shape == (92,)
    with pytest.raises(InputError, match="17 joints, allowed: up to 16"):
        Measured(17)


@pytest.mark.parametrize("cartesian", [None, False, True])
def test_without_python_the_same_is_read_and_written(
    settings: Settings, robot: RobotDescription, backend: MujocoBackend, cartesian: bool | None
) -> None:
    other, command = opened(MujocoBackend, settings, robot), command_at_home(robot)
    one, two = Measured(7), Measured(7)
    if cartesian is not None:
        stiffness = 0.3 * (backend.nominal_cartesian_stiffness if cartesian else backend.nominal_stiffness)
        for arm in (backend, other):
            arm.set_impedance(Impedance(cartesian, stiffness, np.full(len(stiffness), 0.7)))
    for cycle in range(200):
        command[0, 3] += 1e-3 * np.sin(0.1 * cycle)
        backend.write(command)
        backend.read(one)
        assert other.try_write(command)
        assert other.try_read(two)
        np.testing.assert_array_equal(one.values, two.values)


@pytest.mark.parametrize("fault", ["fail_read", "drive_fault"])
def test_a_fault_of_reading_leaves_it_to_python_which_says_why(backend: MujocoBackend, fault: str) -> None:
    measured = Measured(7)
    setattr(backend, fault, "no answer")
    measured.values[:] = 5.0
    assert not backend.try_read(measured)
    np.testing.assert_array_equal(measured.values, 5.0)
    with pytest.raises(BackendError, match="no answer"):
        backend.read(measured)
    setattr(backend, fault, "")
    assert backend.try_read(measured)


def test_of_two_faults_of_reading_one_remains_when_the_other_is_gone(backend: MujocoBackend) -> None:
    backend.fail_read, backend.drive_fault = "no answer", "drive 3 hot"
    backend.fail_read = ""
    assert not backend.try_read(Measured(7))
    with pytest.raises(BackendError, match="drive 3 hot"):
        backend.read(Measured(7))


def test_a_fault_of_writing_leaves_it_to_python_which_says_why(
    backend: MujocoBackend, robot: RobotDescription
) -> None:
    backend.fail_write = "no answer"
    before = backend._data.time
    assert not backend.try_write(command_at_home(robot))
    with pytest.raises(BackendError, match="no answer"):
        backend.write(command_at_home(robot))
    assert backend._data.time == before
    backend.fail_write = ""
    assert backend.try_write(command_at_home(robot))
    assert backend._data.time > before


def test_a_subclass_in_python_is_asked(settings: Settings, robot: RobotDescription) -> None:
    class Reads(MujocoBackend):
        def read(self, measured: Measured) -> None:
            super().read(measured)
            measured.effort[:] = 1.0

    class Writes(MujocoBackend):
        def write(self, command: np.ndarray) -> None:
            raise BackendError("asked")

    reads, writes = (opened(kind, settings, robot) for kind in (Reads, Writes))
    assert not reads.try_read(Measured(7))
    assert reads.try_write(command_at_home(robot))
    assert writes.try_read(Measured(7))
    assert not writes.try_write(command_at_home(robot))


def test_a_backend_that_does_nothing_without_python_is_asked() -> None:
    class Silent(CompiledBackend):
        pass

    assert not Silent().try_read(Measured(0))
    assert not Silent().try_write(np.zeros((3, 7)))


def test_values_of_another_number_of_joints_are_refused(backend: MujocoBackend) -> None:
    for read in (backend.read, backend.try_read):
        with pytest.raises(ValueError, match="of 6 joints, not 7"):
            read(Measured(6))
    for write in (backend.write, backend.try_write):
        with pytest.raises(ValueError, match="at least 21 numbers"):
            write(np.zeros((3, 6)))
    for wrong in (np.zeros(5), np.zeros(6, dtype=np.float32)):
        with pytest.raises((ValueError, TypeError)):
            backend.push = wrong
        assert backend.push.shape == (6,)
