"""Grippers at the coils and registers of a Modbus device.

Oracle: pymodbus' server in a process of its own, which is read and set by pymodbus' client.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest
from cobot_run import until
from pydantic import ValidationError
from pymodbus.client import ModbusTcpClient
from pymodbus.framer import FramerType

from cobot.grippers import GripperError, HeldObject
from cobot.grippers.digital import DigitalGripper, DigitalOptions
from cobot.grippers.modbus_points import ModbusOptions, ModbusPoints
from cobot.grippers.protocol import Grasp
from cobot.grippers.vacuum import VacuumGripper, VacuumOptions

SERVER = """
import asyncio, sys, warnings
warnings.simplefilter("ignore")
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.framer import FramerType
from pymodbus.server import StartAsyncTcpServer
block = lambda *values: ModbusSequentialDataBlock(1, list(values))
unit = ModbusDeviceContext(di=block(0, 1, 0, 0), co=block(0, 0, 0, 0), ir=block(17, 65535), hr=block(5, 6, 7))
asyncio.run(StartAsyncTcpServer(ModbusServerContext(devices={3: unit}, single=False),
    address=("127.0.0.1", int(sys.argv[1])), framer=FramerType(sys.argv[2])))
"""
UNIT = 3
ANY = Grasp(None, 0.0, 0.0)


class NoPort:
    """The robot's inputs and outputs, which are not to be used."""

    def read(self, name: str) -> float:
        raise AssertionError(f"{name} of the robot is read")

    def set(self, name: str, value: float) -> None:
        raise AssertionError(f"{name} of the robot is set")


class Device:
    """Unit 3 with 4 coils, 4 discrete inputs, 2 input registers and 3 holding registers.

    Attributes:
        eye: pymodbus' client.
        options: of the driver.
    """

    def __init__(self, protocol: str) -> None:
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.port = found.getsockname()[1]
        self.framer = FramerType.SOCKET if protocol == "tcp" else FramerType.RTU
        self.options = {
            "device": f"127.0.0.1:{self.port}",
            "protocol": protocol,
            "unit": UNIT,
            "timeout_s": 2.0,
        }
        self.start()

    def start(self) -> None:
        self._process = subprocess.Popen([sys.executable, "-c", SERVER, str(self.port), self.framer.value])
        self.eye = ModbusTcpClient("127.0.0.1", port=self.port, framer=self.framer)
        until(self.eye.connect)

    def stop(self) -> None:
        self.eye.close()
        self._process.kill()
        self._process.wait()

    def coils(self) -> list[bool]:
        return self.eye.read_coils(0, count=4, device_id=UNIT).bits[:4]


@pytest.fixture(scope="module", params=["tcp", "rtu"])
def shared(request: pytest.FixtureRequest) -> Iterator[Device]:
    made = Device(request.param)
    yield made
    made.stop()


@pytest.fixture
def device(shared: Device) -> Device:
    shared.eye.write_coils(0, [False] * 4, device_id=UNIT)
    shared.eye.write_registers(0, [5, 6, 7], device_id=UNIT)
    return shared


def test_fingers_close_and_open_by_two_coils_and_an_input_tells_whether_they_are_closed(
    device: Device,
) -> None:
    options = DigitalOptions(
        close_output="coil 1",
        open_output="coil 2",
        closed_input="input 1",
        close_time_s=0.001,
        modbus=ModbusOptions(**device.options),
    )
    gripper = DigitalGripper(options, NoPort())
    gripper.connect()
    gripper.grasp(ANY)
    assert device.coils() == [False, True, False, False]
    until(lambda: not gripper.state().moving)
    assert gripper.state().object is HeldObject.NONE, "input 1 is on: closed, with nothing between them"
    gripper.release(None)
    assert device.coils() == [False, False, True, False]
    gripper.disconnect()
    again = DigitalGripper(options, NoPort())
    again.connect()
    assert again.state().commanded_width == options.open_width, "the coils tell the last command"
    again.disconnect()


def test_a_part_between_the_fingers_is_held(device: Device) -> None:
    options = DigitalOptions(
        close_output="coil 0", closed_input="input 0", close_time_s=0.001,
        modbus=ModbusOptions(**device.options),
    )  # fmt: skip
    gripper = DigitalGripper(options, NoPort())
    gripper.connect()
    gripper.grasp(ANY)
    until(lambda: gripper.state().object is HeldObject.HELD_INSIDE)
    assert device.coils()[0]
    gripper.disconnect()


def test_a_cup_has_its_vacuum_in_a_register(device: Device) -> None:
    options = VacuumOptions(
        output="coil 3", sensor="register 2", threshold=60.0, modbus=ModbusOptions(**device.options)
    )
    gripper = VacuumGripper(options, NoPort())
    gripper.connect()
    gripper.grasp(ANY)
    assert device.coils()[3]
    assert gripper.state().moving
    device.eye.write_register(2, 70, device_id=UNIT)
    until(lambda: gripper.state().object is HeldObject.HELD_INSIDE)
    device.eye.write_register(2, 20, device_id=UNIT)
    assert gripper.state().object is HeldObject.NONE
    gripper.disconnect()


def test_all_kinds_of_points_are_what_the_device_has(device: Device) -> None:
    points = ModbusPoints(ModbusOptions(**device.options))
    points.open()
    names = ("input 0", "input 1", "input register 0", "input register 1", "register 1")
    assert [points.read(name) for name in names] == [0.0, 1.0, 17.0, 65535.0, 6.0]
    points.set("register 1", 1234.0)
    points.set("coil 2", 1.0)
    assert device.eye.read_holding_registers(1, count=1, device_id=UNIT).registers == [1234]
    assert device.coils()[2]
    for name, value, words in (
        ("coil 9000", 1.0, "rejects the request: illegal address"),
        ("input 0", 1.0, "input 0 is an input of the Modbus device; name a coil or a register"),
        ("register 0", 65536.0, "register 0 is 65536, allowed: 0 to 65535"),
        ("relay 1", 1.0, "'relay 1' is not a point of a Modbus device; valid names: coil N"),
    ):
        with pytest.raises(GripperError, match=words):
            points.set(name, value)
    points.close()
    with pytest.raises(GripperError, match="the Modbus device is not connected"):
        points.read("coil 0")


def test_a_device_that_is_killed_and_comes_back_is_found_again_by_the_next_connect() -> None:
    device = Device("tcp")
    gripper = DigitalGripper(
        DigitalOptions(close_output="coil 0", modbus=ModbusOptions(**device.options)), NoPort()
    )
    gripper.connect()
    device.stop()
    with pytest.raises(GripperError, match=f"127.0.0.1:{device.port}, unit 3: the Modbus device has"):
        gripper.close()
    with pytest.raises(GripperError, match=f"127.0.0.1:{device.port} cannot be opened"):
        gripper.connect()
    device.start()
    gripper.connect()
    gripper.close()
    assert device.coils()[0]
    gripper.disconnect()
    device.stop()


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (b"", "has not answered within"),
        (b"\x00\x01\x00\x00\x00", "has not answered within"),
        (b"HTTP/1.1 400 Bad Request\r\n", "has sent an invalid answer .*: it may not speak Modbus TCP"),
        (b"\x00\x01\x00\x00\x00\x04\x03\x02\x01\x01", "has sent an invalid answer"),  # to another function
        (b"\x00\x01\x00\x00\x00\x03\x03\x81\x02", "rejects the request: illegal address"),
    ],
)
def test_a_wrong_answer_is_an_error_in_words(sent: bytes, words: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        where = f"127.0.0.1:{server.getsockname()[1]}"
        points = ModbusPoints(ModbusOptions(device=where, unit=UNIT, timeout_s=0.2))
        points.open()
        peer, _ = server.accept()
        with peer:
            peer.settimeout(5.0)
            answer = threading.Thread(target=lambda: (peer.recv(64), peer.sendall(sent)))
            answer.start()
            with pytest.raises(GripperError, match=words):
                points.read("coil 0")
            answer.join()
        points.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"close_output": "valve.close"}, "'valve.close' is not a point of a Modbus device"),
        ({"close_output": "input 1"}, "input 1 is an input of the Modbus device"),
        ({"close_output": "coil 65536"}, "with N from 0 to 65535"),
        ({"close_output": "coil 1", "closed_input": "sensor"}, "'sensor' is not a point"),
    ],
)
def test_options_with_other_names_are_rejected(options: dict[str, str], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        DigitalOptions.model_validate(options | {"modbus": {"device": "127.0.0.1:502"}})
