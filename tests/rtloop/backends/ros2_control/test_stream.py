"""The stream to a forward controller of ros2_control, beside one in the same process.

Oracle: what the test puts on the socket, and the list of commands that the controller has received.
"""

from __future__ import annotations

import socket
import time
from types import SimpleNamespace

import numpy as np
import pytest
from ros2_control_settings import settings_with

from cobot.config import load_settings
from cobot.robot.description import load_robot
from rtloop.backends import BackendError, Measured, queued_outputs
from rtloop.backends.ros2_control import Ros2ControlStream
from rtloop.backends.ros2_control.stream_link import StreamProcess
from rtloop.backends.ros2_control.stream_rig import RigStream, StreamRig


def test_the_newest_joint_state_counts_and_has_an_age() -> None:
    link = StreamProcess({"answer_timeout_s": 1.0}, 2)
    rows = np.zeros((3, 2))
    assert link.latest(rows) == np.inf
    own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    own.setblocking(False)
    link._socket = own
    with other:
        now_s = time.monotonic()
        for value in (1.0, 2.0):
            other.send(np.array([now_s, value, value, 0.1, 0.1, 5.0, 5.0]).tobytes())
        age_s = link.latest(rows)
        assert 0.0 <= age_s < 60.0
        np.testing.assert_array_equal(rows, [[2.0, 2.0], [0.1, 0.1], [5.0, 5.0]])
        assert link.latest(rows) >= age_s
        link.command(np.array([3.0, 4.0]))
        np.testing.assert_array_equal(np.frombuffer(other.recv(100)), [3.0, 4.0])
    own.close()


@pytest.fixture
def rig() -> StreamRig:
    settings = settings_with(connect_s=0.1)
    return StreamRig(Ros2ControlStream, settings, load_robot(load_settings()).limits)


def test_nothing_is_sent_between_a_fault_and_the_reset(rig: StreamRig) -> None:
    """Else a controller that is activated again would jump to the old position."""
    settings = settings_with(connect_s=0.1)
    arm = Ros2ControlStream(settings, load_robot(load_settings()).limits, RigStream(rig))
    arm.open(np.zeros(7))
    arm.enable()
    measured = Measured(7)
    arm.read(measured)
    command = np.zeros((3, 7))
    command[0] = measured.position
    arm.write(command)
    assert len(rig.wire) == 1
    rig.inject("e_stop")
    with pytest.raises(BackendError, match="forward_position_controller is inactive"):
        arm.read(measured)
    rig.clear("e_stop")
    arm.write(command)
    assert len(rig.wire) == 1
    with pytest.raises(BackendError, match="is inactive"):
        arm.read(measured)
    arm.enable()
    arm.read(measured)
    arm.write(command)
    assert len(rig.wire) == 2


def test_nothing_is_sent_after_a_silence_that_the_thread_overlooks(
    rig: StreamRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cycle finds the joint states too old while the thread examines the facts of its last poll."""
    settings = settings_with(connect_s=0.1)
    arm = Ros2ControlStream(settings, load_robot(load_settings()).limits, RigStream(rig))
    arm.open(np.zeros(7))
    arm.enable()
    measured, latest = Measured(7), arm._stream.latest
    arm.read(measured)
    command = np.zeros((3, 7))
    command[0] = measured.position

    def overlooked(_: object) -> str:
        monkeypatch.setattr(arm._stream, "latest", lambda rows: np.inf)
        monkeypatch.setattr(arm, "_look", lambda: None)  # the thread's, in which this is
        with pytest.raises(BackendError, match="joint_states"):
            arm.read(measured)
        return ""

    monkeypatch.setattr(arm, "_of_driver", overlooked)
    arm._look()
    monkeypatch.setattr(arm._stream, "latest", latest)
    arm.read(measured)
    arm.write(command)
    assert not rig.wire


def test_a_stream_sets_outputs_with_its_next_poll() -> None:
    settings = settings_with(connect_s=0.1, outputs={"suction": "tool/vacuum"})
    rig = StreamRig(Ros2ControlStream, settings, load_robot(load_settings()).limits)
    backend = rig.backend()
    assert isinstance(backend, Ros2ControlStream)
    assert backend.capabilities.io
    backend.open(np.zeros(7))
    backend.set_output("suction", 1.0)
    assert rig.gpio == {}
    backend.read(Measured(7))
    assert rig.gpio == {"tool/vacuum": 1.0}
    with pytest.raises(BackendError, match="blow is not an output"):
        backend.set_output("blow", 1.0)


def test_a_stream_does_not_set_an_output_that_has_waited_for_a_hanging_driver(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    settings = settings_with(connect_s=0.1, outputs={"suction": "tool/vacuum", "blow": "tool/valve"})
    rig = StreamRig(Ros2ControlStream, settings, load_robot(load_settings()).limits)
    backend = rig.backend()
    backend.open(np.zeros(7))
    monkeypatch.setattr(queued_outputs, "time", SimpleNamespace(monotonic=lambda: 100.0))
    backend.set_output("suction", 1.0)
    monkeypatch.setattr(queued_outputs, "time", SimpleNamespace(monotonic=lambda: 102.5))
    backend.set_output("blow", 1.0)
    backend.read(Measured(7))
    assert rig.gpio == {"tool/valve": 1.0}
    assert "tool/vacuum is not set to 1: the device has not answered for 2.5 s" in caplog.text


def test_joint_states_that_are_too_slow_for_a_stream_are_refused(rig: StreamRig) -> None:
    rig.period_s = 0.0099
    settings = settings_with(connect_s=0.1)
    settings = settings.model_copy(update={"rt": settings.rt.model_copy(update={"frozen_after_s": 0.015})})
    arm = Ros2ControlStream(settings, load_robot(load_settings()).limits, RigStream(rig))
    with pytest.raises(BackendError, match="is 101 Hz; the minimum for a stream is 133 Hz"):
        arm.open(np.zeros(7))
