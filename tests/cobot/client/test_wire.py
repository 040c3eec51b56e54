"""Binary frames. Oracle: struct, by the table in the module's docstring; numpy for the records."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from cobot.client.wire import FrameKind, header, packed, record
from cobot.errors import InputError, LayoutError
from cobot.ipc.layout import setpoint_dtype
from cobot.ipc.state_fields import LAYOUT_VERSION, state_dtype

DOF = 7
SEED = 20261122


def test_a_frame_is_a_header_and_the_records_bytes() -> None:
    sent = np.frombuffer(
        np.random.default_rng(SEED).bytes(state_dtype(DOF).itemsize), state_dtype(DOF)
    ).reshape(())
    frame = packed(FrameKind.STATE, 2**40 + 3, sent)
    assert struct.unpack_from("<IIQ", frame) == (1, LAYOUT_VERSION, 2**40 + 3)
    assert frame[16:] == sent.tobytes()
    assert header(frame) == (FrameKind.STATE, 2**40 + 3)
    assert record(frame, DOF).tobytes() == sent.tobytes()


@pytest.mark.parametrize("kind", [FrameKind.ESTOP, FrameKind.END])
def test_some_kinds_have_no_record(kind: FrameKind) -> None:
    frame = packed(kind, 1)
    assert len(frame) == 16
    assert record(frame, DOF).dtype.itemsize == 0
    with pytest.raises(InputError, match=f"a record {kind.name.lower()} has 0 bytes, got 1"):
        record(frame + b"x", DOF)


def test_what_is_no_frame_is_refused() -> None:
    with pytest.raises(InputError, match="begins with 16 bytes of header, got 15 bytes"):
        header(bytes(15))
    with pytest.raises(LayoutError, match=f"layout version {LAYOUT_VERSION + 1}, but this program has"):
        header(struct.pack("<IIQ", 1, LAYOUT_VERSION + 1, 0))
    with pytest.raises(InputError, match=r"no binary frame of kind 9; valid kinds: 1 \(state\), 2"):
        header(struct.pack("<IIQ", 9, LAYOUT_VERSION, 0))


@pytest.mark.parametrize("surplus", [-1, 1])
def test_a_record_of_another_robot_is_refused(surplus: int) -> None:
    frame = packed(FrameKind.SETPOINT, 1, np.zeros((), setpoint_dtype(DOF + surplus)))
    with pytest.raises(InputError, match="a record setpoint has"):
        record(frame, DOF)


def test_the_record_is_a_copy() -> None:
    frame = bytearray(packed(FrameKind.SETPOINT, 1, np.zeros((), setpoint_dtype(DOF))))
    taken = record(bytes(frame), DOF)
    taken["number"] = 5
    assert record(bytes(frame), DOF)["number"] == 0
