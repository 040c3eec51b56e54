"""Texts for the states of a controller."""

from __future__ import annotations

from rtloop.backends.ur.fields import SafetyMode, UrRobotMode

DRIVES: dict[int, str] = {
    UrRobotMode.NO_CONTROLLER: "no controller",
    UrRobotMode.DISCONNECTED: "the arm is not connected to its controller",
    UrRobotMode.CONFIRM_SAFETY: "waits for a person to confirm the safety configuration",
    UrRobotMode.BOOTING: "starting",
    UrRobotMode.POWER_OFF: "off",
    UrRobotMode.POWER_ON: "starting",
    UrRobotMode.IDLE: "on",
    UrRobotMode.BACKDRIVE: "guided by hand with the brakes released",
    UrRobotMode.RUNNING: "on",
    UrRobotMode.UPDATING_FIRMWARE: "updating firmware",
}
RESTART = "see the teach pendant's log, and restart the safety system there"
HINDERED: dict[int, str] = {
    SafetyMode.PROTECTIVE_STOP: "protective stop: the controller has stopped the arm; clear its way",
    SafetyMode.RECOVERY: "recovery mode: a joint or the TCP is outside the safety limits; move the arm back "
    "at the teach pendant",
    SafetyMode.SAFEGUARD_STOP: "safeguard stop: a safeguard is open; close and reset it",
    SafetyMode.SYSTEM_EMERGENCY_STOP: "emergency stop of the system; release and reset it",
    SafetyMode.ROBOT_EMERGENCY_STOP: "emergency stop at the robot or teach pendant; release its button",
    SafetyMode.VIOLATION: f"safety violation: a safety limit was exceeded; {RESTART}",
    SafetyMode.FAULT: f"fault of the safety system; {RESTART}",
    SafetyMode.VALIDATE_JOINT_ID: "the joints must be validated at the teach pendant",
    SafetyMode.UNDEFINED_SAFETY_MODE: "the safety mode is undefined: the controller is starting",
    SafetyMode.AUTOMATIC_MODE_SAFEGUARD_STOP: "safeguard stop of the automatic mode; close and reset it",
    SafetyMode.SYSTEM_THREE_POSITION_ENABLING_STOP: "the three-position switch is not in its middle position",
}
"""Texts of the safety modes in which the arm cannot move: all except NORMAL and REDUCED."""
UNLOCKABLE = SafetyMode.PROTECTIVE_STOP
LOCAL = (
    "the controller is in Local Control, in which it does not accept programs over the network: press Local "
    "at the top right of the teach pendant and choose Remote Control (enabled in Settings, System, Remote "
    "Control)"
)
SWITCH_ON: dict[int, str] = {
    UrRobotMode.POWER_OFF: "the arm is off: press ON, then START at the teach pendant",
    UrRobotMode.POWER_ON: "the arm is starting: wait, then press START at the teach pendant",
    UrRobotMode.IDLE: "the brakes are applied: press START at the teach pendant",
    UrRobotMode.BACKDRIVE: "the brakes are released (backdrive): leave backdrive at the teach pendant",
}


def mode_in_words(mode: int) -> str:
    return DRIVES.get(mode, f"robot mode {mode}")


def hindrance(safety: int) -> str:
    """Return the reason why the arm cannot move; "" if the safety mode permits motion."""
    if safety in (SafetyMode.NORMAL, SafetyMode.REDUCED):
        return ""
    return HINDERED.get(safety, f"safety mode {safety}")
