"""The Robotiq driver at the simulated gripper: over a pseudo terminal, RTU over TCP, and the URCap's text.

Oracle: the simulated fingers, which foreign clients drive in test_robotiq_clients.py.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from cobot_run import WAIT_S
from pymodbus.framer import FramerRTU

from cobot.grippers import GripperError, GripperState, HeldObject
from cobot.grippers.modbus import crc, framed, is_whole
from cobot.grippers.protocol import Grasp
from cobot.grippers.robotiq.driver import RobotiqGripper, RobotiqOptions
from cobot.grippers.robotiq.registers import Activation, Detection, Request, RobotiqStatus
from cobot.grippers.robotiq.rig import RobotiqRig
from cobot.grippers.robotiq.simulator import Simulator, run_simulator
from cobot.grippers.robotiq.slave import Fingers, Slave
from cobot.grippers.robotiq.text_slave import TextSlave


class NoPort:
    """The driver needs no input or output of the robot."""

    def read(self, name: str) -> float:
        raise GripperError(name)

    def set(self, name: str, value: float) -> None:
        raise GripperError(name)


@pytest.fixture(params=["pty", "tcp", "urcap"])
def way(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    with run_simulator() as made:
        made.slave.fingers.activation_s = 0.05
        yield made


def driver(simulator: Simulator, way: str = "tcp", **options: object) -> RobotiqGripper:
    options.setdefault("timeout_s", 2.0)  # a busy computer is no fault of the device
    port = simulator.urcap_port if way == "urcap" else simulator.port
    device = simulator.device if way == "pty" else f"127.0.0.1:{port}"
    options["protocol"] = "urcap" if way == "urcap" else "rtu"
    made = RobotiqGripper(RobotiqOptions.model_validate({"device": device, **options}), NoPort())
    made.connect()
    return made


def until(gripper: RobotiqGripper, condition: Callable[[GripperState], object]) -> GripperState:
    """The state when the condition first holds."""
    end_s = time.monotonic() + WAIT_S
    while not condition(state := gripper.state()):
        assert time.monotonic() < end_s, state
    return state


def still(gripper: RobotiqGripper) -> GripperState:
    return until(gripper, lambda state: not state.moving)


def ready(simulator: Simulator, way: str = "tcp", **options: object) -> RobotiqGripper:
    made = driver(simulator, way, **options)
    made.home()
    still(made)
    return made


@pytest.mark.parametrize("data", [b"", b"\x09\x03\x07\xd0\x00\x03", bytes(range(256))])
def test_checksums_are_those_of_another_implementation(data: bytes) -> None:
    assert crc(data).to_bytes(2, "little") == FramerRTU.compute_CRC(data).to_bytes(2, "big")
    assert is_whole(framed(data)) == bool(data)


def test_registers_are_read_as_they_were_written() -> None:
    request = Request(True, True, 200, 128, 64)
    assert Request.of(request.words) == request
    status = RobotiqStatus(True, True, Activation.COMPLETE, Detection.STOPPED_CLOSING, 0, 255, 120, 0.4)
    assert RobotiqStatus.of(status.words) == status


def test_it_grasps_holds_and_releases(simulator: Simulator, way: str) -> None:
    gripper = ready(simulator, way)
    simulator.slave.fingers.object_m = 0.04
    gripper.grasp(Grasp(0.04, 0.005, 0.005, force=100.0))
    assert gripper.state().moving
    state = still(gripper)
    assert (state.object, state.width) == (HeldObject.HELD_INSIDE, pytest.approx(0.04, abs=0.0004))
    assert state.force == pytest.approx(100.0, abs=1.0)
    gripper.release(None)
    state = still(gripper)
    assert (state.object, state.width) == (HeldObject.NONE, 0.085)
    gripper.disconnect()


def test_a_grasp_of_nothing_holds_nothing(simulator: Simulator) -> None:
    gripper = ready(simulator)
    gripper.grasp(Grasp(0.06, 0.005, 0.005))
    state = still(gripper)
    assert (state.object, state.width) == (HeldObject.NONE, pytest.approx(0.052, abs=0.0004))
    gripper.disconnect()


def test_a_part_that_is_pulled_out_is_not_held_any_more(simulator: Simulator) -> None:
    gripper = ready(simulator)
    simulator.slave.fingers.object_m = 0.04
    gripper.grasp(Grasp(0.04, 0.005, 0.005))
    assert still(gripper).object is HeldObject.HELD_INSIDE
    simulator.slave.fingers.object_m = None
    assert until(gripper, lambda state: state.object is HeldObject.NONE and not state.moving)
    gripper.disconnect()


def test_a_stop_on_the_way_stops_the_fingers_and_keeps_a_grip(simulator: Simulator) -> None:
    gripper = ready(simulator)
    gripper.move(0.0, 0.02, None)
    until(gripper, lambda state: state.width is not None and state.width < 0.083)
    gripper.stop()
    stopped = still(gripper).width
    assert stopped is not None
    assert 0.07 < stopped < 0.085
    assert still(gripper).width == stopped
    simulator.slave.fingers.object_m = 0.04
    gripper.grasp(Grasp(None, 0.0, 0.0))
    still(gripper)
    before = simulator.slave.fingers.request
    gripper.stop()
    assert simulator.slave.fingers.request == before
    gripper.disconnect()


def test_a_new_command_replaces_the_one_that_is_under_way(simulator: Simulator) -> None:
    gripper = ready(simulator)
    gripper.move(0.0, 0.02, None)
    gripper.move(0.08, None, None)
    assert still(gripper).width == pytest.approx(0.08, abs=0.0004)
    gripper.disconnect()


def test_connecting_moves_nothing_and_a_new_driver_finds_the_grip(simulator: Simulator) -> None:
    gripper = ready(simulator)
    simulator.slave.fingers.object_m = 0.03
    gripper.grasp(Grasp(None, 0.0, 0.0))
    still(gripper)
    before = simulator.slave.fingers.request
    gripper.disconnect()
    again = driver(simulator)
    assert again.state().object is HeldObject.HELD_INSIDE
    assert simulator.slave.fingers.request == before
    again.disconnect()


def test_a_gripper_that_is_not_activated_says_what_to_do_and_does_not_move(simulator: Simulator) -> None:
    gripper = driver(simulator)
    assert "POST /robot/gripper/home" in gripper.state().fault
    with pytest.raises(GripperError, match="not activated: POST /robot/gripper/home"):
        gripper.move(0.04, None, None)
    assert simulator.slave.fingers.request == Request(False, False)
    gripper.disconnect()


@pytest.mark.parametrize(
    ("number", "words"), [(0x08, "too hot"), (0x0E, "overcurrent"), (0x0D, "activation")]
)
def test_faults_of_the_device_are_words(simulator: Simulator, number: int, words: str) -> None:
    gripper = ready(simulator)
    simulator.slave.fingers.fault = number
    assert words in gripper.state().fault
    gripper.disconnect()


def test_silence_garbage_and_late_answers_are_errors_and_none_is_taken_for_the_next(
    simulator: Simulator, way: str
) -> None:
    gripper = ready(simulator, way, timeout_s=0.1)
    simulator.slave.silent = True
    with pytest.raises(GripperError, match=r"has not answered.* within 0\.1 s"):
        gripper.state()
    simulator.slave.silent, simulator.slave.garbage = False, True
    with pytest.raises(
        GripperError, match=r"has sent an invalid answer|answers .* expected a value|not answered"
    ):
        gripper.connect()
    simulator.slave.garbage, simulator.late_s = False, 0.25
    for _ in range(3):
        with pytest.raises(GripperError, match="has not answered"):
            gripper.connect()
    simulator.late_s = 0.0
    gripper.disconnect()
    again = ready(simulator, way)
    assert again.state().width == 0.085
    again.disconnect()


def test_a_closed_connection_is_an_error_in_words() -> None:
    with run_simulator() as simulator:
        gripper = driver(simulator)
    with pytest.raises(GripperError, match=r"lost its connection|has not answered"):
        gripper.state()
    gripper.disconnect()
    with pytest.raises(GripperError, match="cannot be opened"):
        gripper.connect()


def test_a_serial_port_that_another_program_uses_is_an_error(simulator: Simulator) -> None:
    first = driver(simulator, "pty")
    with pytest.raises(GripperError, match="another program"):
        driver(simulator, "pty")
    first.disconnect()


def test_two_clients_at_once_over_tcp_get_their_own_answers(simulator: Simulator) -> None:
    first, second = ready(simulator), driver(simulator)
    found: list[GripperState] = []
    thread = threading.Thread(target=lambda: found.extend(second.state() for _ in range(100)))
    thread.start()
    states = [first.state() for _ in range(100)]
    thread.join()
    assert {each.width for each in (*found, *states)} == {0.085}
    first.disconnect()
    second.disconnect()


def test_bytes_that_are_no_request_are_thrown_away(simulator: Simulator) -> None:
    slave = simulator.slave
    ask = framed(b"\x09\x03\x07\xd0\x00\x03")
    assert slave.feed(b"\x00\xff" * 7 + ask[:3]) == b""
    answer = slave.feed(ask[3:])
    assert answer[:3] == b"\x09\x03\x06"
    assert is_whole(answer)
    assert slave.feed(framed(b"\x09\x03\x00\x00\x00\x03"))[:3] == b"\x09\x83\x02"
    assert slave.feed(framed(b"\x09\x06\x03\xe8\x00\x03"))[:3] == b"\x09\x86\x01"


@pytest.mark.parametrize(
    ("options", "words"),
    [({"open_count": 9, "closed_count": 9}, "must be above open_count"), ({"model": "3f"}, "2f85")],
)
def test_options_that_make_no_gripper_are_rejected(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        RobotiqOptions.model_validate({"device": "/dev/ttyUSB0", **options})


@pytest.mark.parametrize(
    "device", ["ttyUSB0", "COM3", "10.0.0.2", "10.0.0.2:", ":54321", "10.0.0.2:99999", "10.0.0.2:x", "a:b:1"]
)
def test_a_device_that_is_neither_a_path_nor_an_address_is_rejected(device: str) -> None:
    with pytest.raises(ValueError, match=r"it must be a path such as /dev/ttyUSB0, or HOST:PORT"):
        RobotiqOptions.model_validate({"device": device})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"device": "10.0.0.2", "unit": 3}, "unit is for protocol rtu, but the protocol is urcap"),
        ({"device": "10.0.0.2", "baud": 9600}, "baud is for protocol rtu"),
        ({"device": "/dev/ttyUSB0"}, "with urcap it must be HOST or HOST:PORT"),
        ({"device": "10.0.0.2:0"}, "with urcap it must be HOST or HOST:PORT"),
    ],
)
def test_the_urcap_has_neither_a_serial_port_nor_an_address_on_a_bus(
    options: dict[str, object], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        RobotiqOptions.model_validate({"protocol": "urcap", **options})


@pytest.mark.parametrize("way", ["pty", "tcp"])
def test_no_answer_of_another_gripper_is_taken(simulator: Simulator, way: str) -> None:
    with pytest.raises(GripperError, match=r"unit 3: the gripper has not answered"):
        driver(simulator, way, unit=3, timeout_s=0.1)


def test_a_late_answer_is_never_that_to_the_next_request(simulator: Simulator) -> None:
    """Without a new connection: the width has changed since the late answer was made."""
    gripper = ready(simulator, "pty", timeout_s=0.2)
    simulator.late_s = 0.3
    with pytest.raises(GripperError, match="has not answered"):
        gripper.state()
    simulator.slave.fingers.take(Request(True, True, 255, 255, 0))
    simulator.late_s = 0.0
    assert until(gripper, lambda state: not state.moving).width == 0.0
    gripper.disconnect()


def test_a_serial_port_that_is_pulled_out_is_an_error_in_words_and_its_end_is_none() -> None:
    with run_simulator() as simulator:
        gripper = ready(simulator, "pty", timeout_s=0.5)
    for call in (gripper.state, gripper.open):
        with pytest.raises(GripperError, match=r"lost its connection|has not answered"):
            call()
    gripper.disconnect()
    gripper.disconnect()


def test_a_line_that_never_stops_sending_is_an_error() -> None:
    class Noise:
        """A line with another baud rate."""

        def read(self, count: int) -> bytes:
            return b"\x55" * count

        def write(self, data: bytes) -> None: ...
        def reset_input_buffer(self) -> None: ...
        def close(self) -> None: ...

    made = RobotiqGripper(RobotiqOptions(device="/dev/ttyUSB0"), NoPort(), connect=Noise)
    with pytest.raises(GripperError, match="has sent an invalid answer"):
        made.connect()
    with pytest.raises(GripperError, match="does not stop sending: check baud rate and wiring"):
        made.state()


def test_an_activation_that_does_not_come_about_ends_in_words() -> None:
    """As when its supply fails while it activates."""
    options = RobotiqOptions(device="/dev/ttyUSB0")
    rig = RobotiqRig(options)
    gripper = rig.gripper(NoPort())
    gripper.connect()
    gripper.home()
    rig.fingers.take(Request(False, False))
    assert gripper.state().moving
    rig.step(16.0)
    state = gripper.state()
    assert (state.moving, "POST /robot/gripper/home" in state.fault) == (False, True)
    gripper.home()
    rig.fingers.fault = 0x0A
    assert gripper.state().fault == "the supply voltage is too low: check the 24 V supply of the gripper"


Scripted = Callable[[list[bytes]], RobotiqGripper]


@pytest.fixture
def scripted() -> Iterator[Scripted]:
    """Makes a driver at a URCap with these answers."""
    quiet, other = socket.socketpair()

    class Connection:
        def __init__(self, answers: list[bytes]) -> None:
            self._left = list(answers)

        def fileno(self) -> int:
            return quiet.fileno()

        def sendall(self, data: bytes) -> None: ...

        def recv(self, count: int) -> bytes:
            if not self._left:
                raise TimeoutError
            return self._left.pop(0)

        def close(self) -> None: ...

    options = RobotiqOptions(device="10.0.0.2", protocol="urcap")
    yield lambda answers: RobotiqGripper(options, NoPort(), connect=lambda: Connection(answers))
    quiet.close()
    other.close()


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        ([b"POS 3\n"], "answers 'POS 3' to 'GET STA', expected a value from 0 to 3"),
        ([b"STA 4\n"], "answers 'STA 4' to 'GET STA', expected a value from 0 to 3"),
        ([b"?"], r"answers '\?' to 'GET STA'"),
        ([b"\xff" * 64], "to 'GET STA'"),
        ([b""], "has ended the connection"),
        ([], "has not answered 'GET STA' within"),
    ],
)
def test_the_urcap_s_garbage_is_an_error(scripted: Scripted, answers: list[bytes], words: str) -> None:
    gripper = scripted(answers)
    with pytest.raises(GripperError, match=words):
        gripper.connect()


def test_answers_of_the_urcap_in_pieces_and_without_a_newline_are_whole(scripted: Scripted) -> None:
    pieces = [b"STA", b" 3\n", b"GTO 1\r\n", b"OBJ 3\n", b"FLT 0\n", b"PRE", b" 255\n", b"POS 250"]
    scripted(pieces).connect()


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        (b"GET POS\n", b"POS 0\n"),
        (b"GET XYZ\n", b"?"),
        (b"SET POS 256\n", b"?"),
        (b"SET POS -1\n", b"?"),
        (b"SET POS\n", b"?"),
        (b"SET STA 3\n", b"?"),
        (b"\xff\x00\n", b"?"),
        (b"SET POS 7 SPE 9\nGET SPE\n", b"ackSPE 9\n"),
        (b"GET PO", b""),
    ],
)
def test_the_simulated_urcap_answers_lines(line: bytes, answer: bytes) -> None:
    assert TextSlave(Slave(Fingers("2f85", time.monotonic))).feed(line) == answer


def test_clients_that_do_not_read_stop_nobody(simulator: Simulator) -> None:
    """Floods of requests whose answers stay unread, on the terminal and over TCP."""
    ask = framed(b"\x09\x03\x07\xd0\x00\x03") * 30
    with open(simulator.device, "wb", buffering=0) as terminal:
        for _ in range(20):
            terminal.write(ask)
    gripper = ready(simulator, "urcap")
    assert gripper.state().width == 0.085
    gripper.disconnect()
