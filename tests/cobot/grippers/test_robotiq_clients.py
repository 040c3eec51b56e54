"""Clients of Robotiq grippers that others have written, at the simulated gripper. They are the oracle.

Each waits as long as a busy computer may take. Their own timeouts are 0.05 to 5 s.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pyrobotiqgripper
import pyrobotiqur
import pytest
import robotiq2f
import robotiq2f.robotiq2f as library
from cobot_run import WAIT_S, until
from pyrobotiqur.enums import ObjectStatus

from cobot.grippers.robotiq.simulator import Simulator, run_simulator


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    with run_simulator() as made:
        made.slave.fingers.activation_s = 0.1
        yield made


def over_serial(simulator: Simulator) -> pyrobotiqgripper.RobotiqGripper:
    return pyrobotiqgripper.RobotiqGripper(com_port=simulator.device)


def over_tcp(simulator: Simulator) -> pyrobotiqgripper.RobotiqGripper:
    return pyrobotiqgripper.RobotiqGripper(
        connection_type=pyrobotiqgripper.GRIPPER_MODE_RTU_VIA_TCP, tcp_port=simulator.port
    )


@pytest.mark.parametrize("connect", [over_serial, over_tcp])
def test_pyrobotiqgripper_activates_moves_and_detects_an_object(
    simulator: Simulator, connect: Callable[[Simulator], pyrobotiqgripper.RobotiqGripper]
) -> None:
    gripper = connect(simulator)
    gripper.timeOut = gripper._client.comm_params.timeout_connect = WAIT_S
    gripper.connect()
    gripper.activate()
    assert gripper.isActivated()
    gripper.start()
    gripper.move(100)
    assert gripper.position() == 100
    assert simulator.slave.fingers.width_m == pytest.approx(0.085 * (1 - 100 / 255))
    simulator.slave.fingers.object_m = 0.03
    gripper.close()
    assert gripper.position() == pytest.approx(255 * (1 - 0.03 / 0.085), abs=1)
    gripper.readStatus()
    assert gripper.status()["gOBJ"] == 2
    gripper.open()
    assert gripper.position() == 0
    gripper.disconnect()


def test_robotiq2f_activates_moves_and_detects_an_object(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library.LinuxFindTTYWithSerialNumber, "find", lambda self, number: simulator.device)
    with robotiq2f.Robotiq2F85("any", async_control=False) as gripper:
        gripper.client.serial.timeout = WAIT_S
        gripper.activate()
        gripper.go_to(opening=50.0, speed=150.0, force=50.0)
        until(lambda: abs(gripper.goal_opening - 50.0) < 0.5 and not gripper.is_moving)
        assert gripper.opening == pytest.approx(50.0, abs=0.5)
        assert not gripper.object_detected
        simulator.slave.fingers.object_m = 0.03
        gripper.go_to(opening=0.0, speed=150.0, force=50.0)
        until(lambda: gripper.goal_opening < 0.5 and not gripper.is_moving)  # its status may be 5 ms old
        assert gripper.object_detected
        where = gripper.count_to_opening(round(255 * (1 - 0.03 / 0.085)))  # by its own calibration
        assert gripper.opening == pytest.approx(where, abs=0.5)


def test_pyrobotiqur_activates_moves_and_detects_an_object(simulator: Simulator) -> None:
    """Over the text protocol of the URCap."""
    with pyrobotiqur.RobotiqGripper("127.0.0.1", simulator.urcap_port, WAIT_S) as gripper:
        gripper.activate(poll_interval=0.01)
        assert gripper.move(100) == (100, ObjectStatus.AT_DEST)
        assert simulator.slave.fingers.width_m == pytest.approx(0.085 * (1 - 100 / 255))
        simulator.slave.fingers.object_m = 0.03
        position, found = gripper.move(255)
        assert position == pytest.approx(255 * (1 - 0.03 / 0.085), abs=1)
        assert found is ObjectStatus.STOPPED_INNER_OBJECT
        assert gripper.get_fault() == 0
        with pytest.raises(RuntimeError, match="SET STA failed"):
            gripper.set_var("STA", 3)
