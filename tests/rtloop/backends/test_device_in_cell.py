"""A simulated cell around the arm of another simulator. Oracles: MuJoCo's bodies, weights."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from physical_cell import EXAMPLE, CellArm

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot.description import load_robot
from cobot.robot.device import Capabilities, DeviceStatus
from cobot.robot.io_points import IoKind, IoPoint
from cobot.types import Array, PlannerName
from rtloop.backends import BackendError, HasCell, HasIo, Measured, Paced, Reporting, Simulated, make_backend
from rtloop.backends.device_in_cell import NOTE, DeviceInCell

POLLED = 50
"""Cycles between two reports of the device."""


class PolledArm:
    """A device that is where it was commanded, and reports this only now and then, as one of a network."""

    capabilities = Capabilities(measured=frozenset({"position", "velocity"}), hardware=True)

    def __init__(self) -> None:
        self.joints = np.zeros((3, 7))
        self.reported = np.zeros((3, 7))
        self.cycles = 0
        self.lamp = 0.0
        self.fault = ""

    def open(self, initial_position: Array) -> None:
        self.joints[0] = self.reported[0] = initial_position

    def enable(self) -> None: ...

    def disable(self) -> None: ...

    def close(self) -> None: ...

    def read(self, measured: Measured) -> None:
        if self.fault:
            raise BackendError(self.fault)
        measured.position[:], measured.velocity[:] = self.reported[:2]

    def write(self, command: Array) -> None:
        self.joints[:] = command
        self.cycles += 1
        if self.cycles % POLLED == 0:
            self.reported[:] = command

    def wait(self, timeout_s: float) -> bool:
        return True

    def status(self) -> DeviceStatus:
        return DeviceStatus(text="all is well")

    def io(self) -> tuple[IoPoint, ...]:
        return (IoPoint("DO[1]", IoKind.BOOLEAN, True, self.lamp),)

    def set_output(self, name: str, value: float) -> None:
        self.lamp = value


class ArmElsewhere(CellArm):
    """seen: called in each cycle."""

    seen: Callable[[], None] = staticmethod(lambda: None)

    def made(self, settings: Settings) -> Any:
        self.device = PolledArm()
        return DeviceInCell(self.device, settings, self.robot.limits)

    def _step(self) -> None:
        self.backend.write(self._command)
        self.backend.read(self.measured)
        self.seen()

    def hold(self, cycles: int = 1) -> None:
        super().hold(max(cycles, 4 * POLLED if cycles > 1 else 1))


@pytest.fixture
def arm(settings: Settings) -> ArmElsewhere:
    made = ArmElsewhere(settings, load_robot(settings))
    made.hold(2)
    return made


def test_a_part_is_carried_by_an_arm_that_reports_in_steps(arm: ArmElsewhere) -> None:
    arm.pick("cube")
    assert arm.read("hand.measured_force") == pytest.approx(40.0, rel=0.05)
    arm.go_to(0.5, 0.12, 0.345, PlannerName.LIN)
    assert arm.read("gate") == 1.0
    arm.go_to(0.55, 0.3, 0.345, PlannerName.LIN)
    place = arm.robot.model.forward(arm.device.reported[0]).position
    np.testing.assert_allclose(arm.part("cube").position, place, atol=2e-3)
    assert arm.read("gate.count") == 1.0


def test_the_steps_of_the_reports_are_no_contact(arm: ArmElsewhere) -> None:
    """The cube weighs 2 N. Without a filter 7.7 N appear, which is near a threshold for contact."""
    forces: list[float] = []
    arm.pick("cube")
    arm.seen = lambda: forces.append(float(np.linalg.norm(arm.measured.wrench[:3])))
    arm.go_to(0.55, 0.3, 0.345)
    assert max(forces) < 5.0


def test_the_force_at_the_tcp_is_the_weight_of_the_part(arm: ArmElsewhere) -> None:
    """The device measures none."""
    assert "wrench" in arm.backend.capabilities.measured
    np.testing.assert_allclose(arm.measured.wrench[:3], 0.0, atol=0.1)
    arm.pick("cube")
    arm.hold(1000)
    np.testing.assert_allclose(arm.measured.wrench[:3], [0.0, 0.0, -0.2 * 9.81], atol=0.1)


def test_faults_of_the_device_are_its_own_and_spoil_no_part(arm: ArmElsewhere) -> None:
    arm.device.fault = "the cable is off"
    with pytest.raises(BackendError, match="the cable is off"):
        arm.backend.read(arm.measured)
    arm.device.fault = ""
    arm.device.reported[0, 3] = math.nan
    for _ in range(10):
        arm.backend.read(arm.measured)
        arm.backend.write(arm._command)
    assert math.isnan(arm.measured.position[3])
    assert arm.part("cube").position == pytest.approx([0.5, -0.3, 0.225], abs=1e-3)


def test_it_has_the_protocols_of_the_device_and_of_the_cell(arm: ArmElsewhere) -> None:
    backend = arm.backend
    for protocol in (Paced, Reporting, HasIo, HasCell):
        assert isinstance(backend, protocol)
    assert not isinstance(backend, Simulated)
    assert backend.status().text == f"all is well; {NOTE}"
    assert backend.capabilities.hardware
    names = [point.name for point in backend.io()]
    assert names[0] == "DO[1]"
    assert "hand.width" in names
    backend.set_output("DO[1]", 1.0)
    assert backend.read_input("DO[1]") == 1.0
    with pytest.raises(BackendError, match=r"hand\.width is 0\.9, allowed: 0 to 0\.08"):
        backend.set_output("hand.width", 0.9)
    with pytest.raises(BackendError, match="there is no input 'nothing'"):
        backend.read_input("nothing")


def test_a_switch_of_the_cell_replaces_the_device_s_input_of_its_name(
    arm: ArmElsewhere, monkeypatch: pytest.MonkeyPatch
) -> None:
    lamp = IoPoint("DO[1]", IoKind.BOOLEAN, True, 0.0)
    monkeypatch.setattr(arm.device, "io", lambda: (lamp, IoPoint("gate", IoKind.BOOLEAN, False, 1.0)))
    gates = [point.value for point in arm.backend.io() if point.name == "gate"]
    assert gates == [0.0] == [arm.backend.read_input("gate")]
    assert arm.backend.io()[0] == lamp


def with_backend(settings: Settings, kind: str, options: dict[str, Any], **sections: Any) -> Settings:
    chosen = settings.robot.backend.model_copy(update={"type": kind, "options": options})
    robot = settings.robot.model_copy(update={"backend": chosen, "cell": EXAMPLE})
    rt = settings.rt.model_copy(update={"period_s": 0.008})
    return settings.model_copy(update={"robot": robot, "rt": rt, **sections})


def test_a_user_says_that_the_device_is_a_simulator(settings: Settings, arm: ArmElsewhere) -> None:
    options = {"address": "127.0.0.1", "simulator": True}
    made = make_backend(with_backend(settings, "fanuc", options), arm.robot.limits)
    assert isinstance(made, DeviceInCell)
    assert made.part_names == ("cube", "bar", "can")


@pytest.mark.parametrize(
    ("kind", "options", "setting"),
    [
        ("fanuc", {"address": "192.168.1.100"}, "robot.backend.address is '192.168.1.100'"),
        ("ur", {"address": "ur5e.local"}, "robot.backend.address is 'ur5e.local'"),
        ("ur", {"address": "127.0.0.1.example.org"}, "robot.backend.address is '127.0.0.1.example.org'"),
        ("fri", {"address": "0.0.0.0"}, "robot.backend.address is '0.0.0.0'"),
        ("rsi", {}, "robot.backend.address is 'None'"),
        ("ros2_control", {}, "ros.localhost_only is false"),
    ],
)
def test_a_controller_elsewhere_has_no_simulated_hand(
    settings: Settings, arm: ArmElsewhere, kind: str, options: dict[str, Any], setting: str
) -> None:
    """A real one may be there. For RSI and FRI no address means the first controller that sends."""
    ros = settings.ros.model_copy(update={"localhost_only": False})
    chosen = with_backend(settings, kind, options | {"simulator": True}, ros=ros)
    with pytest.raises(ConfigError) as found:
        make_backend(chosen, arm.robot.limits)
    assert str(found.value).startswith(f"{setting}, but robot.backend.simulator is true: a simulator must be")
    assert str(found.value).endswith("for a real arm, remove robot.backend.simulator")


def test_a_device_without_a_status_has_the_note_too(settings: Settings, arm: ArmElsewhere) -> None:
    class Silent(PolledArm):
        status = None  # type: ignore[assignment]

    made = DeviceInCell(Silent(), with_backend(settings, "mujoco", {}), arm.robot.limits)
    assert isinstance(made, Reporting)
    assert made.status().text == NOTE
