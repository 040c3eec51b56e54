"""The backend and a simulated controller in one process, period by period. Oracle: what the controller's own
state says, and the arm behind it."""

from __future__ import annotations

import contextlib
import math
import re
import socket
import struct
from collections.abc import Callable

import numpy as np
import pytest
from lockstep_ur import LateCommands, hold
from ur_arm import with_options

from cobot.config import Settings
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription
from cobot.robot.io_points import IoPoint
from cobot.robot.tool import Tool
from cobot.types import Array, PlannerName, Scaling
from rtloop.backends import BackendError, Measured
from rtloop.backends.ur import UrBackend
from rtloop.backends.ur.fields import RuntimeState, SafetyMode, UrRobotMode
from rtloop.backends.ur.rtde import Kind, encode, encode_inputs_setup
from rtloop.backends.ur.simulator import lockstep, rtde_session
from rtloop.backends.ur.simulator.lockstep import UrLockStep, joined
from rtloop.backends.ur.simulator.options import UrControllerOptions
from rtloop.backends.ur.transport import TcpStream

Joined = Callable[..., tuple[UrBackend, UrLockStep]]
ON = UrControllerOptions(is_on=True)


def opened(
    connect: Joined, options: UrControllerOptions = ON, **more: object
) -> tuple[UrBackend, UrLockStep]:
    backend, way = connect(options, **more)
    backend.open(np.zeros(6))
    backend.enable()
    return backend, way


def refusal(backend: UrBackend, way: UrLockStep) -> str:
    """Why the arm takes no commands, by the first command after enabling."""
    with pytest.raises(BackendError) as found:
        hold(backend, way, 50)
    return str(found.value)


def reset(backend: UrBackend) -> None:
    backend.recover_step()
    backend.enable()


def value(backend: UrBackend, name: str) -> float:
    points: dict[str, IoPoint] = {each.name: each for each in backend.io()}
    return points[name].value


@pytest.mark.parametrize("series", ["e", "x"])
def test_an_arm_that_is_off_is_switched_on_and_its_brakes_are_released(connect: Joined, series: str) -> None:
    backend, way = opened(connect, UrControllerOptions(series))
    assert (way.controller.robot_mode, way.controller.runtime) == (UrRobotMode.RUNNING, RuntimeState.PLAYING)
    hold(backend, way, 5)
    assert backend.status().brakes == "released"


def test_a_command_moves_the_arm_and_nothing_else_does(connect: Joined) -> None:
    backend, way = opened(connect)
    hold(backend, way, 200)
    begin = way.controller.arm.setpoint.copy()
    command = np.zeros((3, 6))
    command[0] = begin
    for cycle in range(150):
        command[0, 3] += 0.002 * min(cycle / 50, 1.0)
        backend.wait(0.1)
        backend.write(command)
    way.pass_period()
    np.testing.assert_allclose(way.controller.arm.setpoint - begin, [0, 0, 0, 0.249, 0, 0], atol=0.003)
    measured = Measured(6)
    backend.read(measured)
    assert measured.velocity[3] == pytest.approx(0.25, abs=0.05)


@pytest.mark.parametrize("series", ["e", "cb3"])
def test_without_commands_the_program_stops_the_arm_and_ends(connect: Joined, series: str) -> None:
    backend, way = opened(connect, UrControllerOptions(series=series, is_on=True), timeout_s=0.05)
    controller = way.controller
    hold(backend, way, 200)
    command = np.zeros((3, 6))
    command[0] = controller.arm.setpoint
    for cycle in range(100):
        command[0, 3] += 0.004 * min(cycle / 50, 1.0)
        backend.wait(0.1)
        backend.write(command)
    speed = abs(controller.velocity[3])
    assert speed == pytest.approx(0.5, abs=0.05)
    begun_s, here = controller.time_s, controller.arm.setpoint[3]
    while controller.runtime == RuntimeState.PLAYING:
        way.pass_period()
        assert controller.time_s - begun_s < 0.5
    assert np.abs(controller.velocity).max() < 1e-3
    assert controller.safety == SafetyMode.NORMAL
    # On straight for 0.05 s, then with 10 rad/s².
    straight = speed * 0.05 + speed**2 / 20.0
    assert controller.arm.setpoint[3] - here == pytest.approx(straight, rel=0.3)
    assert "commands were missing for 0.05 s" in refusal(backend, way)
    reset(backend)
    hold(backend, way, 5)


def test_late_and_early_packets_make_no_jump(connect: Joined) -> None:
    """Oracle: second differences of what the drives follow, against the reflex of a jump."""
    backend, way = opened(connect, period_ms=4)
    random = np.random.default_rng(1)
    hold(backend, way, 300)
    command = np.zeros((3, 6))
    begin = way.controller.arm.setpoint.copy()
    for cycle in range(400):
        command[0] = begin + 0.3 * (1.0 - math.cos(0.01 * cycle))
        backend.wait(0.1)
        for _ in range(int(random.integers(0, 4))):
            way.pass_period()
        backend.write(command)
    assert way.controller.safety == SafetyMode.NORMAL, list(way.controller.events)


@pytest.mark.parametrize("period_ms", [2, 4, 8])
def test_the_drives_follow_without_ripple(connect: Joined, period_ms: int) -> None:
    """Between commands as at them: the acceleration in each control step is that of the motion.

    Oracle: the derivatives of the cosine that is commanded.
    """
    backend, way = opened(connect, period_ms=period_ms)
    hold(backend, way, 1200 // period_ms)
    command = np.zeros((3, 6))
    begin = way.controller.arm.setpoint.copy()
    found = []
    for cycle in range(2000 // period_ms):
        time_s = 1e-3 * period_ms * cycle
        command[0] = begin + 0.1 * (1.0 - math.cos(3.0 * time_s))
        backend.wait(0.1)
        backend.write(command)
        found.append(way.controller.values()["target_qdd"][0])
    most = 0.1 * 3.0**2
    assert np.abs(found[50:]).max() == pytest.approx(most, rel=0.1)


@pytest.mark.parametrize("period_ms", [2, 8])
def test_packages_that_are_left_out_make_no_jump(connect: Joined, period_ms: int) -> None:
    """One in five, with accelerations up to 12.5 rad/s². Oracle: the reflex of the controller."""
    backend, way = opened(connect, period_ms=period_ms)
    hold(backend, way, 1200 // period_ms)
    way.network.loss = 0.2
    command = np.zeros((3, 6))
    begin = way.controller.arm.setpoint.copy()
    for cycle in range(2000 // period_ms):
        command[0] = begin + 0.5 * (1.0 - math.cos(5e-3 * period_ms * cycle))
        backend.wait(0.1)
        backend.write(command)
    assert way.network.lost > 20
    assert way.controller.safety == SafetyMode.NORMAL, list(way.controller.events)


@pytest.mark.parametrize("period_ms", [2, 8])
@pytest.mark.parametrize(
    "delays", [[0, 1, 2], [3], [10]], ids=["up to 4 ms at times", "6 ms at once", "20 ms at once"]
)
def test_late_commands_make_no_jump_at_full_speed(connect: Joined, period_ms: int, delays: list[int]) -> None:
    """Up to 2.5 rad/s and 12.5 rad/s². The delay begins at rest, at half and at full speed, and ends at once.

    Oracle: the reflex of the controller.
    """
    backend, way = connect(ON, period_ms=period_ms)
    late = LateCommands(way)
    backend.open(np.zeros(6))
    backend.enable()
    hold(backend, way, 1200 // period_ms)
    command = np.zeros((3, 6))
    random = np.random.default_rng(1)
    begin = way.controller.arm.setpoint.copy()
    for begin_s in (0.0, 0.15, 0.3):
        for cycle in range(3000 // period_ms):
            time_s = min(1e-3 * period_ms * cycle, 2.0 * math.pi / 5.0)
            late.periods = int(random.choice(delays)) if begin_s <= time_s < 1.2 else 0
            command[0] = begin + 0.5 * (1.0 - math.cos(5.0 * time_s))
            backend.wait(0.1)
            backend.write(command)
    assert way.controller.safety == SafetyMode.NORMAL, list(way.controller.events)


@pytest.mark.parametrize("period_ms", [2, 8])
def test_a_delay_in_an_acceleration_to_full_speed_is_no_overspeed(
    connect: Joined, arm: RobotDescription, period_ms: int
) -> None:
    """Commands are 20 ms late while the arm accelerates to its maximum speed, and on time at that speed.

    Oracle: the reflex of the controller, at 1.05 times the joint's velocity.
    """
    backend, way = connect(ON, period_ms=period_ms)
    late = LateCommands(way)
    backend.open(np.zeros(6))
    backend.enable()
    hold(backend, way, 1200 // period_ms)
    goal = np.radians([110.0, -80.0, 90.0, -100.0, -80.0, 20.0])
    request = MotionRequest(way.controller.arm.setpoint.copy(), goal, PlannerName.PTP, Scaling(1.0))
    motion = plan(arm, request)
    assert motion is not None
    command = np.zeros((3, 6))
    for time_s in np.arange(0.0, motion.duration_s + 0.3, 1e-3 * period_ms):
        late.periods = 10 if 0.04 <= time_s < 0.39 else 0
        command[0] = motion.sample([min(time_s, motion.duration_s)])[0]
        backend.wait(0.1)
        backend.write(command)
    assert np.abs(motion.sample(np.linspace(0.0, motion.duration_s, 200), 1)).max() > 3.1
    assert way.controller.safety == SafetyMode.NORMAL, list(way.controller.events)


@pytest.mark.parametrize(
    ("period_ms", "speed", "acceleration", "onward", "braking"),
    [
        (2, 1.0, 0.0, 0.048, 0.049),
        (8, 1.0, 0.0, 0.042, 0.049),
        (2, 1.0, 12.5, 0.0575, 0.077),
        (8, 1.0, 12.5, 0.050, 0.077),
        (2, 3.0, 0.0, 0.144, 0.447),
        (8, 3.0, 0.0, 0.126, 0.447),
    ],
)
def test_the_way_after_the_last_command_is_what_the_page_states(
    connect: Joined, period_ms: int, speed: float, acceleration: float, onward: float, braking: float
) -> None:
    """docs/ur.md has these figures, rounded, from the last commanded position.

    Oracle: the sums of the program's steps of 2 ms; 0.049 is v²/2a with 10 rad/s², less half a step.
    """
    backend, way = opened(connect, period_ms=period_ms)
    hold(backend, way, 1200 // period_ms)
    period_s, ramp = 1e-3 * period_ms, 40 // period_ms
    speeds = np.concatenate(
        [
            np.linspace(0.0, speed - 0.04 * acceleration, 800 // period_ms),
            np.full(80 // period_ms, speed - 0.04 * acceleration),
            speed + acceleration * period_s * np.arange(1 - ramp, 1),
        ]
    )
    places = np.cumsum((speeds[1:] + speeds[:-1]) / 2 * period_s)
    command = np.zeros((3, 6))
    start = way.controller.arm.setpoint.copy()
    for place in places:
        backend.wait(0.1)
        command[0] = start
        command[0, 0] += place
        backend.write(command)
    there, ended_s = command[0, 0], way.controller.time_s
    while way.controller.time_s < ended_s + 0.0499:
        way.pass_period()
    gone = way.controller.arm.setpoint[0] - there
    while way.controller.runtime == RuntimeState.PLAYING:
        way.pass_period()
    assert "cobot: no command in time" in way.controller.events
    assert gone == pytest.approx(onward, abs=3e-3)
    assert way.controller.arm.setpoint[0] - there - gone == pytest.approx(braking, abs=3e-3)
    assert way.controller.safety == SafetyMode.NORMAL


@pytest.mark.parametrize("series", ["e", "x"])
def test_local_control_is_named_with_what_to_press(connect: Joined, series: str) -> None:
    backend, way = opened(connect, UrControllerOptions(series, is_on=True, is_remote=False))
    assert "Remote Control" in refusal(backend, way)
    way.controller.is_remote = True
    reset(backend)
    hold(backend, way, 5)


def test_a_program_that_is_rejected_is_named(connect: Joined, monkeypatch: pytest.MonkeyPatch) -> None:
    backend, way = connect(ON)
    monkeypatch.setattr("rtloop.backends.ur.program.script", lambda *_: "def broken():\n  nonsense()\nend\n")
    backend.open(np.zeros(6))
    backend.enable()
    said = refusal(backend, way)
    assert "rejects cobot's program; it reports: line 2" in said
    assert "'nonsense' is not defined" in said
    monkeypatch.undo()
    reset(backend)
    hold(backend, way, 5)


def test_a_program_that_cannot_connect_back_is_named(connect: Joined) -> None:
    backend, way = connect(ON, enable_s=0.5)
    backend.open(np.zeros(6))
    way.call_back = lambda: (_ for _ in ()).throw(ConnectionRefusedError())  # type: ignore[method-assign]
    backend.enable()
    assert "does not connect to port" in refusal(backend, way)


@pytest.mark.parametrize("action", ["stop", "pause"])
def test_a_program_that_is_stopped_at_the_pendant_is_a_fault_with_a_reset(
    connect: Joined, action: str
) -> None:
    backend, way = opened(connect)
    hold(backend, way, 5)
    if action == "stop":
        way.controller.stop_program("at the teach pendant")
    else:
        way.controller.pause_program()
    said = refusal(backend, way)
    assert "has ended: it was stopped at the teach pendant" in said or "is paused, not playing" in said
    reset(backend)
    hold(backend, way, 5)


def test_a_program_of_somebody_else_is_not_ended(connect: Joined) -> None:
    backend, way = connect(ON)
    way.controller.upload("def theirs():\n  while True:\n    sync()\n  end\nend\n")
    backend.open(np.zeros(6))
    backend.enable()
    assert "another program is playing on the controller" in refusal(backend, way)
    assert way.controller.program_name == "theirs"
    assert way.controller.runtime == RuntimeState.PLAYING
    way.controller.stop_program("by a person")
    reset(backend)
    hold(backend, way, 5)


@pytest.mark.parametrize(
    ("safety", "words"),
    [
        (SafetyMode.PROTECTIVE_STOP, "protective stop"),
        (SafetyMode.RECOVERY, "recovery mode"),
        (SafetyMode.SAFEGUARD_STOP, "safeguard stop"),
        (SafetyMode.SYSTEM_EMERGENCY_STOP, "emergency stop of the system"),
        (SafetyMode.ROBOT_EMERGENCY_STOP, "emergency stop at the robot"),
        (SafetyMode.VIOLATION, "safety violation"),
        (SafetyMode.FAULT, "fault of the safety system"),
        (SafetyMode.SYSTEM_THREE_POSITION_ENABLING_STOP, "three-position switch"),
    ],
)
def test_safety_modes_are_faults_in_words(connect: Joined, safety: SafetyMode, words: str) -> None:
    backend, way = opened(connect)
    hold(backend, way, 5)
    way.controller.set_safety(safety)
    assert words in refusal(backend, way)
    assert words in backend.status().safety_stop
    way.controller.blocked = "Cannot unlock"
    with pytest.raises(BackendError, match=words):
        reset(backend)
    way.controller.blocked = ""
    if safety != SafetyMode.PROTECTIVE_STOP:
        way.controller.set_safety(SafetyMode.NORMAL)
    reset(backend)
    hold(backend, way, 5)


def test_a_protective_stop_is_unlocked_by_the_robot_api_of_polyscope_x(connect: Joined) -> None:
    backend, way = opened(connect, UrControllerOptions("x", is_on=True))
    hold(backend, way, 5)
    way.controller.set_safety(SafetyMode.PROTECTIVE_STOP)
    assert "protective stop" in refusal(backend, way)
    way.controller.blocked = "Cannot unlock until 5 s after it"
    with pytest.raises(
        BackendError, match=r"does not unlock it: status 409 Conflict Cannot unlock until 5 s"
    ):
        reset(backend)
    way.controller.blocked = ""
    reset(backend)
    hold(backend, way, 5)


def test_a_polyscope_x_without_the_robot_api_is_switched_on_by_a_person(
    connect: Joined, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(UrControllerOptions, "version", (10, 10, 0, 0))
    backend, way = opened(connect, UrControllerOptions("x"))
    assert "press ON, then START at the teach pendant" in refusal(backend, way)


def test_reduced_mode_moves_and_is_reported(connect: Joined) -> None:
    backend, way = opened(connect)
    way.controller.set_safety(SafetyMode.REDUCED)
    hold(backend, way, 5)
    assert "reduced mode" in backend.status().text


def test_the_speed_slider_is_followed_and_set(connect: Joined) -> None:
    backend, way = opened(connect)
    way.controller.slider = 0.4
    hold(backend, way, 3)
    assert backend.status().speed_scaling == pytest.approx(0.4)
    backend.set_output("speed_slider", 70.0)
    hold(backend, way, 5)
    assert way.controller.slider == pytest.approx(0.7)
    assert value(backend, "speed_slider") == 70.0
    with pytest.raises(BackendError, match="speed_slider is 101, allowed: 0 to 100"):
        backend.set_output("speed_slider", 101.0)


def test_outputs_are_released_once_they_are_set(connect: Joined) -> None:
    """So that a program or a person at the pendant can change them afterwards."""
    backend, way = opened(connect)
    for name, bit in (("digital_out_3", 3), ("configurable_out_7", 15), ("tool_out_1", 17)):
        backend.set_output(name, 1.0)
        hold(backend, way, 5)
        assert way.controller.digital_out >> bit & 1
        assert value(backend, name) == 1.0
    way.controller.digital_out = 0
    hold(backend, way, 5)
    assert way.controller.digital_out == 0
    way.controller.digital_in = 1 << 16
    hold(backend, way, 3)
    assert value(backend, "tool_in_0") == 1.0


def send_and_lose(
    backend: UrBackend, way: UrLockStep, monkeypatch: pytest.MonkeyPatch, *, relay: bool
) -> None:
    """An output that is sent just after the connection is interrupted, for 3 s."""
    if relay:  # it has the data already, and passes them on later
        monkeypatch.setattr(lockstep._Pipe, "abort", lockstep._Pipe.close)
    hold(backend, way, 3)
    backend.wait(0.1)
    way.off = True
    backend.set_output("digital_out_3", 1.0)
    backend.write(np.zeros((3, 6)))
    for _ in range(30):
        backend.wait(0.1)
    assert not way.controller.digital_out
    way.off = False
    for _ in range(2000):
        backend.wait(0.002)
        with contextlib.suppress(BackendError):  # the program has ended meanwhile
            backend.write(np.zeros((3, 6)))


def test_an_output_that_was_sent_before_a_lost_connection_is_not_set_later(
    connect: Joined, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The backend drops what has not arrived, and says that the output was not set."""
    backend, way = opened(connect)
    send_and_lose(backend, way, monkeypatch, relay=False)
    assert way.controller.digital_out == 0
    assert "digital_out_3 is not confirmed: the device has not reported 1 within 1 s" in backend.status().text


def test_an_output_that_a_relay_delivers_late_is_named(
    connect: Joined, monkeypatch: pytest.MonkeyPatch
) -> None:
    backend, way = opened(connect)
    send_and_lose(backend, way, monkeypatch, relay=True)
    assert way.controller.digital_out == 1 << 3
    text = backend.status().text
    assert re.search(r"digital_out_3 is 1 now, 3\.\d s after the request: .* set the output late", text), text
    reset(backend)
    backend.set_output("digital_out_3", 0.0)
    assert "digital_out_3" not in backend.status().text
    hold(backend, way, 5)
    assert way.controller.digital_out == 0


def test_data_of_a_connection_that_was_given_up_do_not_arrive_later() -> None:
    """Oracle: the kernel. After `close` it would deliver all of them."""

    def arrived(end: Callable[[TcpStream], None]) -> tuple[int, int]:
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            stream = TcpStream(socket.create_connection(server.getsockname()), True)
            other, _ = server.accept()
        sent = 0
        with contextlib.suppress(ConnectionAbortedError):
            while True:
                stream.send(bytes(1000))
                sent += 1000
        end(stream)
        received = 0
        with other, contextlib.suppress(ConnectionResetError):
            while data := other.recv(65536):
                received += len(data)
        return sent, received

    sent, received = arrived(TcpStream.close)
    assert received >= sent
    sent, received = arrived(TcpStream.abort)
    assert received < sent


def test_analog_outputs_have_the_unit_of_their_domain(connect: Joined) -> None:
    backend, way = opened(connect)
    backend.set_output("analog_out_1", 2.5)
    hold(backend, way, 5)
    assert way.controller.analog_out == [0.0, 2.5]
    way.controller.set_analog(0, 0.0, 0)
    hold(backend, way, 3)
    with pytest.raises(BackendError, match=r"analog_out_0 is 5 A, allowed: 0.004 to 0.02 A"):
        backend.set_output("analog_out_0", 5.0)
    backend.set_output("analog_out_0", 0.012)
    hold(backend, way, 5)
    assert way.controller.analog_out[0] == pytest.approx(0.012)


def test_inputs_of_another_client_are_named_and_can_be_left_to_it(connect: Joined) -> None:
    backend, way = connect(ON, connect_s=1.0)
    other = rtde_session.RtdeSession(way.controller, way.network)
    other.feed(encode_inputs_setup(["tool_digital_output_mask", "tool_digital_output"]))
    with pytest.raises(BackendError, match=r"sets tool_digital_output_mask, tool_digital_output \(IN_USE\)"):
        backend.open(np.zeros(6))
    backend.close()
    second, way = connect(ON, outputs=False)
    way.controller.owners["tool_digital_output_mask"] = other
    second.open(np.zeros(6))
    second.enable()
    hold(second, way, 5)
    with pytest.raises(BackendError, match="outputs is false"):
        second.set_output("digital_out_0", 1.0)


def test_a_controller_without_a_variable_is_named(connect: Joined, monkeypatch: pytest.MonkeyPatch) -> None:
    backend, _ = connect(ON)
    known = dict(rtde_session.OUTPUTS)
    del known["target_moment"]
    monkeypatch.setattr(rtde_session, "OUTPUTS", known)
    with pytest.raises(BackendError, match=r"has no variable target_moment \(NOT_FOUND\)"):
        backend.open(np.zeros(6))


def test_variables_that_are_only_useful_may_be_missing(
    connect: Joined, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = dict(rtde_session.OUTPUTS)
    del known["safety_status"], known["tool_analog_input1"]
    monkeypatch.setattr(rtde_session, "OUTPUTS", known)
    backend, way = opened(connect)
    hold(backend, way, 5)
    assert "tool_analog_in_1" not in {each.name for each in backend.io()}


def test_another_version_of_the_protocol_is_named(connect: Joined, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rtde_session, "PROTOCOL", 1)
    backend, _ = connect(ON)
    with pytest.raises(BackendError, match="rejects version 2 of RTDE's protocol"):
        backend.open(np.zeros(6))


def test_a_stranger_at_the_port_is_named(connect: Joined, monkeypatch: pytest.MonkeyPatch) -> None:
    backend, _ = connect(ON, connect_s=1.0)
    monkeypatch.setattr(
        rtde_session.RtdeSession, "feed", lambda self, received: self.out.extend(b"HTTP/1.1 400 Bad Request")
    )
    with pytest.raises(BackendError, match="are not valid RTDE: a package has the unknown type 84"):
        backend.open(np.zeros(6))


def test_a_broken_data_package_is_named_and_the_connection_set_up_again(connect: Joined) -> None:
    backend, way = opened(connect)
    hold(backend, way, 5)
    _, pipe = next(each for each in way._sessions if isinstance(each[0], rtde_session.RtdeSession))
    pipe.send(encode(Kind.DATA, struct.pack(">B", 1)))
    measured = Measured(6)
    for _ in range(20):
        backend.wait(0.008)
    with pytest.raises(BackendError, match="are not valid RTDE: a data package has 1 bytes"):
        backend.read(measured)
    for _ in range(200):
        backend.wait(0.008)
    reset(backend)
    hold(backend, way, 5)


def test_a_half_open_connection_is_given_up(connect: Joined) -> None:
    """The other end is gone without a word: nothing arrives, and no error either."""
    backend, way = opened(connect)
    hold(backend, way, 5)
    sessions, way._sessions = way._sessions, []
    for session, _ in sessions:
        session.close()
    measured = Measured(6)
    for _ in range(50):
        backend.wait(0.008)
    with pytest.raises(BackendError, match=r"no data from the controller for 0\.4"):
        backend.read(measured)
    for _ in range(300):
        backend.wait(0.008)
    reset(backend)
    hold(backend, way, 5)


def test_a_cb3_needs_its_own_period(connect: Joined) -> None:
    backend, _ = connect(UrControllerOptions(series="cb3"), period_ms=2)
    with pytest.raises(BackendError, match=r"sends every 0\.008 s, but rt\.period_s is 0\.002 s"):
        backend.open(np.zeros(6))


def test_without_the_dashboard_a_person_switches_on(connect: Joined) -> None:
    backend, way = opened(connect, UrControllerOptions(), dashboard=False)
    assert "press ON, then START at the teach pendant" in refusal(backend, way)
    way.controller.release_brakes()
    for _ in range(60):
        backend.wait(0.008)
    reset(backend)
    hold(backend, way, 5)


def test_the_tool_reaches_the_controller(connect: Joined) -> None:
    backend, way = connect(ON)
    backend.set_tool(Tool(mass=1.25, centre=(0.01, -0.02, 0.05)))
    backend.open(np.zeros(6))
    backend.enable()
    hold(backend, way, 5)
    assert way.controller.payload == pytest.approx(1.25)
    assert way.controller.centre == pytest.approx([0.01, -0.02, 0.05])
    backend.set_tool(Tool())
    hold(backend, way, 5)
    assert way.controller.payload == 0.0


def test_a_wrong_model_is_rejected(connect: Joined, monkeypatch: pytest.MonkeyPatch) -> None:
    backend, way = connect(ON)
    pose = way.controller.pose
    monkeypatch.setattr(way.controller, "pose", lambda: [pose()[0] + 0.02, *pose()[1:]])
    backend.open(np.zeros(6))
    backend.enable()
    assert "the device reports its flange at" in refusal(backend, way)


@pytest.mark.parametrize("change", [np.degrees, np.flip], ids=["degrees", "another order"])
def test_joints_in_other_units_or_another_order_are_rejected(
    connect: Joined, monkeypatch: pytest.MonkeyPatch, change: Callable[[list[float]], Array]
) -> None:
    backend, way = connect(ON)
    values = way.controller.values

    def changed() -> dict[str, object]:
        found = values()
        return found | {name: change(found[name]).tolist() for name in ("actual_q", "target_q")}

    monkeypatch.setattr(way.controller, "values", changed)
    before = way.controller.arm.setpoint.copy()
    backend.open(np.zeros(6))
    backend.enable()
    assert "the device reports its flange at" in refusal(backend, way)
    np.testing.assert_allclose(way.controller.arm.setpoint, before)


@pytest.mark.parametrize("turned", [False, True])
def test_forces_are_along_the_axes_of_the_models_base(
    connect: Joined, monkeypatch: pytest.MonkeyPatch, turned: bool
) -> None:
    """A controller whose base is turned from the model's reports x and y with the other sign."""
    backend, way = connect(ON)
    x, y, z, *turn = way.controller.pose()
    values = way.controller.values
    sign = -1.0 if turned else 1.0
    if turned:
        about_z = _turned_about_z(turn)
        monkeypatch.setattr(way.controller, "pose", lambda: [-x, -y, z, *about_z])
    force = [sign * 3.0, sign * 4.0, 5.0, sign * 0.1, sign * 0.2, 0.3]
    monkeypatch.setattr(way.controller, "values", lambda: values() | {"actual_TCP_force": force})
    backend.open(np.zeros(6))
    backend.enable()
    hold(backend, way, 5)
    measured = Measured(6)
    backend.read(measured)
    np.testing.assert_allclose(measured.wrench, [3.0, 4.0, 5.0, 0.1, 0.2, 0.3])


def _turned_about_z(turn: list[float]) -> list[float]:
    from scipy.spatial.transform import Rotation

    found = Rotation.from_euler("z", np.pi) * Rotation.from_rotvec(turn)
    return [float(each) for each in found.as_rotvec()]


def test_a_jump_is_a_protective_stop_of_the_controller(connect: Joined) -> None:
    backend, way = opened(connect)
    hold(backend, way, 200)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint + 0.3
    backend.wait(0.1)
    backend.write(command)
    with pytest.raises(BackendError, match="protective stop"):
        hold(backend, way, 10)
    assert way.controller.safety == SafetyMode.PROTECTIVE_STOP


def test_an_arm_with_other_joints_is_rejected(
    ur: Settings, arm: RobotDescription, settings: Settings
) -> None:
    from cobot.robot.description import load_robot

    limits = load_robot(settings).limits
    with pytest.raises(BackendError, match="has 6 joints, but this robot has 7"):
        UrBackend(with_options(settings), limits, transport=joined(ur, arm.limits))


def test_a_program_that_ends_before_its_cause_is_reported_does_not_hide_it(connect: Joined) -> None:
    """The connection of the program ends at once, the emergency stop is in a later package.

    Oracle: the order in which a controller's two connections are read.
    """
    backend, way = opened(connect)
    hold(backend, way, 5)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    backend.wait(0.1)
    way.controller.set_safety(SafetyMode.ROBOT_EMERGENCY_STOP)
    backend._program.poll()
    assert not backend._program.is_connected
    backend.write(command)
    assert "emergency stop" in refusal(backend, way)
