"""Texts for the controller's alarms, error numbers and states, with advice."""

from __future__ import annotations

import re
from collections.abc import Iterable

from cobot.foreign import joined_text
from rtloop.backends.fanuc.messages import ContactStop, RobotFlag, StatusPacket

MAX_ALARM = 160
RESET = "then POST /robot/reset"
ALARMS = {
    "SRVO-001": "the emergency stop of the operator panel is pressed: release it",
    "SRVO-002": "the emergency stop of the teach pendant is pressed: release it",
    "SRVO-003": "the enabling switch of the teach pendant is released",
    "SRVO-004": "the fence is open: close it",
    "SRVO-007": "an external emergency stop is pressed: release it",
    "SRVO-021": "the servos are not ready",
    "SRVO-023": "an axis is too far from its command at rest",
    "SRVO-024": "an axis is too far from its command in motion",
    "SRVO-037": "IMSTP, the immediate stop input, is on",
    "SRVO-050": "the controller has detected a collision",
    "SRVO-115": "an axis is beyond its limit: move it back with the teach pendant",
    "SRVO-230": "the two channels of the safety chain differ: a person must check it",
    "SYST-322": "the automatic status check has timed out: restart the controller",
    "SYST-348": "the payload must be confirmed at the teach pendant",
    "HOST-380": "Stream Motion has received a packet that it does not know, or has a second client",
    "MOTN-615": "Stream Motion needs brake control to be disabled for all axes, and a restart after that",
    "MOTN-625": "Stream Motion has received a position that it cannot use",
}
"""Texts for FANUC's alarm codes. Other alarms are shown with the controller's own text."""
ERRORS = {
    2556934: "the TP program cannot run: is another program selected or running, or an alarm active?",
    2556935: "the arm's servos are off: release the emergency stop, close the fence, clear the alarms",
    2556936: "the TP program cannot run: is another program selected or running, or an alarm active?",
    2556937: "the Remote Motion Interface is not running: initialize it, or restart the controller",
    2556940: "it cannot be reset: the cause of its alarm persists",
    2556941: "it does not know this request: its software is too old, or an option is missing",
    2556943: "it is in the wrong state: AUTO mode, teach pendant off, no alarm, remote operation",
    2556944: "it must be switched off and on again",
    2556945: "this payload schedule does not exist",
    2556949: "a value of the request is invalid",
    2556952: "it is in HOLD: release HOLD at the teach pendant",
    2556954: "another client is in control: it serves one client of the Remote Motion Interface at a time",
    2556957: "the number of the instruction is not the next one",
    2556966: "this number of an input or output does not exist",
    2556971: "it is in single-step mode: switch STEP off at the teach pendant",
    2556981: "this TP program does not exist: is option J519 installed?",
    7004: "the TP program is in use by another client",
    7015: "RMI_MOVE is the selected program at the teach pendant: select a different program",
}
"""Texts for the error numbers of the Remote Motion Interface (B-84184EN, appendix)."""
_NUMBER = re.compile(r"[A-Z]{4}-[0-9]{3}")


def error_in_words(number: int) -> str:
    known = ERRORS.get(number)
    return f"{known} (ErrorID {number})" if known else f"ErrorID {number}"


def alarm_in_words(alarm: object) -> str:
    """Return an alarm from the controller with its meaning. The alarm may be any value."""
    said = joined_text(alarm, MAX_ALARM)
    found = _NUMBER.search(said)
    meaning = ALARMS.get(found.group()) if found else None
    return f"{meaning} ({said})" if meaning else said


def alarms_in_words(alarms: Iterable[object]) -> str:
    return "; ".join(filter(None, map(alarm_in_words, alarms)))


def safety_stop(packet: StatusPacket) -> str:
    """Return the reason for a safety stop of the robot; "" if the robot is not stopped."""
    if packet.robot_status & RobotFlag.EMERGENCY_STOP:
        return "an emergency stop is pressed, or the fence is open"
    if packet.contact_stop == ContactStop.STOP:
        return "the collaborative robot has stopped at a contact"
    if packet.contact_stop == ContactStop.ESCAPE:
        return "the collaborative robot is being pushed out of a contact"
    return ""


def why_not_ready(packet: StatusPacket) -> str:
    """Return the reason why the controller accepts no commands; "" if it accepts them."""
    stop = safety_stop(packet)
    if stop:
        return stop
    if packet.robot_status & RobotFlag.PENDANT:
        return "the teach pendant is on (T1 or T2): select AUTO and switch it off"
    if packet.robot_status & RobotFlag.ERROR:
        return "the controller has an alarm"
    if not packet.motion_possible:
        return "the controller's Stream Motion program is not running, or has ended"
    return ""
