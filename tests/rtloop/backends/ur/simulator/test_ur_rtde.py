"""ur_rtde's receive, I/O and dashboard clients at our controller. Oracle: clients that others wrote."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from ur_arm import POSITIONS, ur_folder
from ur_run import ControllerProcess

from cobot.config import SETTINGS_FILE

dashboard_client = pytest.importorskip("dashboard_client", reason="ur_rtde is not installed")
rtde_io = pytest.importorskip("rtde_io", reason="ur_rtde is not installed")
rtde_receive = pytest.importorskip("rtde_receive", reason="ur_rtde is not installed")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs loopback addresses besides 127.0.0.1")
WAIT_S = 30.0


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ControllerProcess]:
    settings: Path = ur_folder(tmp_path_factory.mktemp("arm")) / SETTINGS_FILE
    with ControllerProcess(settings) as started:
        yield started


def until(happened: Callable[[], bool]) -> None:
    until_s = time.monotonic() + WAIT_S
    while not happened():
        assert time.monotonic() < until_s
        time.sleep(0.01)


def test_its_clients_read_switch_on_and_set(controller: ControllerProcess) -> None:
    dashboard = dashboard_client.DashboardClient(controller.address)
    dashboard.connect()
    receive = rtde_receive.RTDEReceiveInterface(controller.address)
    outputs = rtde_io.RTDEIOInterface(controller.address)
    try:
        assert dashboard.polyscopeVersion().startswith("5.")
        assert dashboard.isInRemoteControl()
        assert dashboard.robotmode() == "Robotmode: POWER_OFF"
        assert receive.getRobotMode() == 3
        dashboard.powerOn()
        until(lambda: receive.getRobotMode() == 5)
        dashboard.brakeRelease()
        until(lambda: receive.getRobotMode() == 7)
        home = np.radians(POSITIONS["home"])
        np.testing.assert_allclose(receive.getActualQ(), home, atol=1e-2)
        np.testing.assert_allclose(receive.getTargetQ(), home, atol=1e-6)
        assert (receive.getSafetyMode(), receive.getSafetyStatusBits(), receive.getRuntimeState()) == (
            1,
            1,
            1,
        )

        assert outputs.setStandardDigitalOut(3, True)
        assert outputs.setConfigurableDigitalOut(2, True)
        assert outputs.setToolDigitalOut(1, True)
        assert outputs.setSpeedSlider(0.6)
        assert outputs.setAnalogOutputVoltage(0, 0.25)
        assert outputs.setInputIntRegister(20, -7)
        bits = 1 << 3 | 1 << 10 | 1 << 17
        until(lambda: receive.getActualDigitalOutputBits() == bits)
        until(lambda: receive.getTargetSpeedFraction() == 0.6)
        until(lambda: receive.getStandardAnalogOutput0() == 2.5)
        told = controller.ask(inputs=0b101)
        assert (told["digital_out"], told["slider"], told["analog_out"]) == (bits, 0.6, [2.5, 0.0])
        until(lambda: receive.getActualDigitalInputBits() == 0b101)

        controller.ask(safety=3)
        until(receive.isProtectiveStopped)
        assert dashboard.safetystatus() == "Safetystatus: PROTECTIVE_STOP"
        dashboard.unlockProtectiveStop()
        until(lambda: not receive.isProtectiveStopped())
        controller.ask(safety=7)
        until(receive.isEmergencyStopped)
        assert dashboard.robotmode() == "Robotmode: POWER_OFF"
        controller.ask(safety=1)
    finally:
        outputs.disconnect()
        receive.disconnect()
        dashboard.disconnect()
