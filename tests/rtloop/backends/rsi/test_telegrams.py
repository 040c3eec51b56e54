"""The telegrams. Oracles: the XML reader of the standard library, and packets written by hand."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtloop.backends.rsi.telegrams import (
    RobState,
    SenAnswer,
    TelegramLayout,
    decode_rob,
    decode_sen,
    encode_rob,
    encode_sen,
)
from rtloop.backends.rsi.xml_reader import MAX_ELEMENTS, MAX_PACKET

DEGREES = 180.0 / math.pi
SIX = TelegramLayout(
    tuple(f"A{number}" for number in range(1, 7)), np.full(6, DEGREES), "AK", "EK", "cobot", (), ()
)
RAIL = TelegramLayout(
    ("E1", *SIX.axes), np.array([1e3, *SIX.scale]), "AK", "EK", "cobot", ("part",), ("open", "close")
)
"""A robot on a linear axis, which is the first joint of the model."""
AXES = 'A1="0.0" A2="-90.0" A3="90.0" A4="0.0" A5="45.0" A6="-180.0"'
ROB = (
    '<Rob Type="KUKA"><RIst X="445.0" Y="0.0" Z="790.0" A="180.0" B="0.0" C="180.0"/>'
    f'<AIPos {AXES}/><ASPos {AXES}/><MACur A1="1.2"/><Delay D="3"/><OvPro>50</OvPro>'
    '<State T1="0" T2="0" AUT="0" EXT="1" Ready="1" NoStop="1"/><CorrMode>1</CorrMode>'
    "<Strange>7</Strange><IPOC>4208163634</IPOC></Rob>"
)


def test_a_telegram_is_read_in_radians() -> None:
    state = decode_rob(ROB.encode(), SIX)
    assert isinstance(state, RobState), state
    np.testing.assert_allclose(state.position, [0, -math.pi / 2, math.pi / 2, 0, math.pi / 4, -math.pi])
    assert state.setpoint == state.position
    assert (state.ipoc, state.delay, state.override, state.mode) == (4_208_163_634, 3, 0.5, "absolute")
    assert (state.operation_mode, state.is_ready, state.is_stopped) == ("EXT", True, False)
    assert state.pose == (445.0, 0.0, 790.0, 180.0, 0.0, 180.0)


def test_what_a_context_does_not_fill_in_is_not_reported() -> None:
    none = ROB.replace('EXT="1" Ready="1" NoStop="1"', 'EXT="0.00" Ready="0" NoStop="0"')
    state = decode_rob(none.encode(), SIX)
    assert isinstance(state, RobState)
    assert (state.operation_mode, state.is_ready, state.is_stopped) == ("", None, None)


@given(
    position=st.lists(st.floats(-6.0, 6.0), min_size=7, max_size=7),
    ipoc=st.integers(0, 2**63 - 1),
    bits=st.lists(st.booleans(), min_size=3, max_size=3),
)
def test_an_encoded_telegram_is_what_the_standard_library_reads(
    position: list[float], ipoc: int, bits: list[bool]
) -> None:
    state = RobState(
        ipoc, tuple(position), tuple(position), inputs=(bits[0],), outputs=tuple(bits[1:]), delay=0
    )
    packet = encode_rob(RAIL, state)
    root = ET.fromstring(packet)
    assert float(root.find("EIPos").attrib["E1"]) == pytest.approx(1e3 * position[0], abs=1e-6)  # type: ignore[union-attr]
    assert float(root.find("ASPos").attrib["A6"]) == pytest.approx(DEGREES * position[6], abs=1e-6)  # type: ignore[union-attr]
    again = decode_rob(packet, RAIL)
    assert isinstance(again, RobState), again
    np.testing.assert_allclose(again.position, position, atol=1e-8)
    assert (again.ipoc, again.inputs, again.outputs) == (ipoc, state.inputs, state.outputs)


@given(st.lists(st.integers(-360_000_000, 360_000_000), min_size=7, max_size=7), st.integers(0, 2**63 - 1))
def test_an_answer_has_each_correction_exactly(corrections: list[int], ipoc: int) -> None:
    packet = encode_sen(RAIL, ipoc, corrections, (True, False))
    root = ET.fromstring(packet)
    assert (root.tag, root.attrib, root.findtext("IPOC")) == ("Sen", {"Type": "cobot"}, str(ipoc))
    robot, external = root.find("AK"), root.find("EK")
    assert robot is not None
    assert external is not None
    assert list(robot.attrib) == list(SIX.axes)
    assert list(external.attrib) == ["E1"]
    micro = [round(1e6 * float(value)) for value in (external.attrib["E1"], *robot.attrib.values())]
    assert micro == corrections
    assert decode_sen(packet, RAIL) == SenAnswer(ipoc, tuple(corrections), (True, False))


ENTITY = '<!DOCTYPE Rob [<!ENTITY a "1"><!ENTITY b "&a;&a;&a;">]>'
DEEP = ROB.replace("<Strange>7</Strange>", "<Strange><Deeper/></Strange>")
WRONG: dict[str, tuple[str, str]] = {
    "nothing": ("", "not XML"),
    "no XML": ("hello", "not XML"),
    "half of one": (ROB[:100], "not XML"),
    "two documents": (ROB + ROB, "not XML"),
    "an entity": (ENTITY + ROB, "document type"),
    "an unknown entity": (ROB.replace("50", "&a;"), "not XML"),
    "an instruction": ("<?php 1?>" + ROB, "processing instruction"),
    "another root": (ROB.replace("Rob", "Bob"), "the root element is 'Bob'; it must be Rob"),
    "another Type": (ROB.replace("KUKA", "ABB"), "the Type 'ABB'; it must be KUKA"),
    "no Type": (ROB.replace(' Type="KUKA"', ""), "the Type ''; it must be KUKA"),
    "a deeper level": (DEEP, "'Deeper' is inside another element"),
    "an element twice": (ROB.replace("<Strange>7</Strange>", "<IPOC>1</IPOC>"), "'IPOC' occurs twice"),
    "an attribute twice": (ROB.replace('A2="-90.0"', 'A1="1"'), "duplicate attribute"),
    "no positions": (
        ROB.replace("AIPos", "AXPos"),
        "the telegram has no AIPos: add DEF_AIPos to the Ethernet configuration",
    ),
    "no time stamp": (ROB.replace("IPOC", "IPO"), "the telegram has no IPOC"),
    "a missing axis": (ROB.replace(' A3="90.0"', "", 1), "AIPos has no attribute A3"),
    "a seventh axis": (ROB.replace('A1="0.0"', 'A1="0.0" A7="1.0"'), "an unknown axis 'A7'"),
    "not a number": (ROB.replace("-90.0", "nan"), "AIPos.A2 is 'nan', which is not a finite number"),
    "infinite": (ROB.replace("-90.0", "inf"), "AIPos.A2 is 'inf'"),
    "too large a power": (ROB.replace("-90.0", "1e999"), "AIPos.A2 is '1e999'"),
    "a decimal comma": (ROB.replace("-90.0", "-90,0"), "AIPos.A2 is '-90,0'"),
    "Python's underscore": (ROB.replace("-90.0", "-9_0.0"), "AIPos.A2 is '-9_0.0'"),
    "another script": (ROB.replace("-90.0", "٩٠"), "AIPos.A2 is '\\u0669\\u0660'"),
    "far away": (ROB.replace("-90.0", "-9000000"), "the maximum is 1e+06"),
    "a negative time": (ROB.replace("4208163634", "-1"), "IPOC is '-1'"),
    "a fraction of a time": (ROB.replace("4208163634", "1.5"), "IPOC is '1.5'"),
    "a time without end": (ROB.replace("4208163634", "9" * 30), "IPOC is"),
    "two modes": (ROB.replace('T1="0"', 'T1="1"'), "the operation mode is T1 and EXT"),
    "a bit of 2": (ROB.replace('EXT="1"', 'EXT="2"'), "State.EXT is '2'; it must be 0 or 1"),
    "a long text": (ROB.replace("<Strange>7", "<Strange>" + "7" * 300), "text is longer than"),
    "a long packet": (ROB.replace("<Strange>", " " * MAX_PACKET + "<Strange>"), "is longer than"),
    "many elements": (
        ROB.replace("<Strange>7</Strange>", "".join(f"<S{n}/>" for n in range(MAX_ELEMENTS))),
        "more than 200 elements",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(name: str) -> None:
    packet, reason = WRONG[name]
    found = decode_rob(packet.encode(), SIX)
    assert isinstance(found, str)
    assert reason in found
    assert len(found) < 300
    assert found.isprintable()


def test_an_axis_that_no_joint_is_must_not_move() -> None:
    four = replace(SIX, axes=SIX.axes[:4], scale=SIX.scale[:4])
    assert "axis A5 is at '45.0' degrees, but the model has no such joint" in str(
        decode_rob(ROB.encode(), four)
    )
    still = ROB.replace('A5="45.0" A6="-180.0"', 'A5="0.0" A6="0.0"')
    assert isinstance(decode_rob(still.encode(), four), RobState)


def test_an_external_axis_that_is_not_reported_is_named() -> None:
    found = decode_rob(ROB.encode(), RAIL)
    assert found == "the telegram has no EIPos: add DEF_EIPos to the Ethernet configuration of the controller"


@given(st.binary(max_size=300))
def test_any_bytes_are_rejected(packet: bytes) -> None:
    assert isinstance(decode_rob(packet, SIX), str)
    assert isinstance(decode_sen(packet, SIX), str)


@given(st.data())
def test_a_damaged_telegram_is_read_or_rejected(data: st.DataObject) -> None:
    packet = bytearray(ROB.encode())
    for _ in range(data.draw(st.integers(1, 4))):
        packet[data.draw(st.integers(0, len(packet) - 1))] = data.draw(st.integers(0, 255))
    found = decode_rob(bytes(packet), SIX)
    assert isinstance(found, str) or np.isfinite(found.position).all()
