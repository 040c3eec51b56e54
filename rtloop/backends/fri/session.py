"""Evaluates the controller's packets: whether it accepts commands, and whether the settings match it."""

from __future__ import annotations

import numpy as np

from cobot.types import Array
from rtloop.backends.fri.messages import (
    DriveState,
    MonitoringMessage,
    OperationMode,
    Quality,
    SafetyState,
    SessionState,
)
from rtloop.backends.fri.options import COMMAND_MODES, FriOptions
from rtloop.results import ACCEPTED, Accepted, Rejected

STOPPED = {
    SafetyState.SAFETY_STOP_LEVEL_0: "safety stop 0: the drives are off and the brakes applied",
    SafetyState.SAFETY_STOP_LEVEL_1: "safety stop 1: the arm comes to rest, then its drives are switched off",
    SafetyState.SAFETY_STOP_LEVEL_2: "safety stop 2: the arm is held at rest with its drives on",
}
STATES = {
    SessionState.IDLE: "the controller has no FRI session: start or resume its program",
    SessionState.MONITORING_WAIT: "the controller waits for a connection that is good enough",
    SessionState.MONITORING_READY: "the controller's program has not begun its motion with the FRI overlay",
    SessionState.COMMANDING_WAIT: "the controller's motion waits to begin",
    SessionState.COMMANDING_ACTIVE: "",
}
HAND_GUARDED = (OperationMode.T1, OperationMode.T2)
"""Modes in which the operator must hold the enabling switch for a motion."""


def takes_commands(message: MonitoringMessage) -> bool:
    return message.state == SessionState.COMMANDING_ACTIVE and message.quality >= Quality.GOOD


def check_readiness(message: MonitoringMessage) -> Accepted | Rejected:
    """Check that the controller accepts commands."""
    if message.safety != SafetyState.NORMAL_OPERATION:
        return Rejected(STOPPED[message.safety])
    if takes_commands(message):
        return ACCEPTED
    reason = STATES[message.state] or "the controller has a motion with the FRI overlay"
    if message.quality < Quality.GOOD and message.state != SessionState.IDLE:
        reason += f"; the quality of the connection is {message.quality.name}, "
        reason += "the controller accepts commands from GOOD on"
    mode = message.operation_mode
    if mode in HAND_GUARDED and message.state == SessionState.MONITORING_READY:
        reason += f"; the operation mode is {mode.name}: a change of the mode ends the motion, and no motion "
        reason += "begins without the enabling switch"
    if any(drive == DriveState.OFF for drive in message.drives):
        reason += "; drives are off"
    return Rejected(f"{reason} (session {message.state.name})")


def is_version(found: str, wanted: str) -> bool:
    """Whether the option `wanted` allows the version `found`, which is "1.x", "2.x" or "2.7"."""
    return found == wanted or found.split(".")[0] == wanted


def check_settings(message: MonitoringMessage, options: FriOptions, period_s: float) -> Accepted | Rejected:
    """Check that this controller can be used with these settings."""
    if options.version != "auto" and message.version and not is_version(message.version, options.version):
        return Rejected(
            f"the controller uses FRI {message.version}, but robot.backend.version is "
            f"{options.version}: set it to the controller's version or to auto"
        )
    if round(period_s * 1e3, 6) != message.send_period_ms:
        return Rejected(
            f"the controller sends every {message.send_period_ms} ms, but rt.period_s is {period_s:g} "
            f"s: set it to {message.send_period_ms * 1e-3:g}, or the send period in the controller's "
            "program"
        )
    return ACCEPTED


def check_command_mode(message: MonitoringMessage, options: FriOptions) -> Accepted | Rejected:
    """Check that the controller's motion uses the overlay in the options. An unknown overlay is accepted."""
    wanted = COMMAND_MODES[options.overlay]
    if message.state < SessionState.COMMANDING_WAIT or message.command_mode == wanted:
        return ACCEPTED
    taken = message.command_mode.name
    return Rejected(
        f"the controller's motion accepts {taken}, but robot.backend.overlay is {options.overlay}"
    )


def check_entry(
    message: MonitoringMessage, options: FriOptions, names: tuple[str, ...], held: tuple[float, ...]
) -> Accepted | Rejected:
    """Check that the arm is at its commanded position, so that commands may begin.

    Args:
        held: position of the controller's interpolator, or the last command if a motion is running.
    """
    off: Array = np.abs(np.subtract(message.measured_position, held))
    joint = int(off.argmax())
    if not off[joint] <= options.entry_rad:
        return Rejected(
            f"{names[joint]} is {off[joint]:.6g} rad from the controller's interpolator, allowed: "
            f"{options.entry_rad} rad (robot.backend.entry_rad)"
        )
    tracking = message.tracking_performance
    if tracking is not None and not tracking >= options.min_tracking:
        return Rejected(
            f"the tracking performance of the arm is {tracking:.6g}; at least {options.min_tracking} is "
            "needed (robot.backend.min_tracking)"
        )
    return ACCEPTED


def interpolator(message: MonitoringMessage) -> tuple[float, ...]:
    """Return the controller's interpolator position, or the measured position if the controller does not
    report it.
    """
    return message.ipo_position or message.commanded_position or message.measured_position


def drives_in_words(drives: tuple[DriveState, ...]) -> tuple[str, str]:
    """Describe the drives and brakes in words. FRI does not report the brakes, but an LBR applies them when
    its drives are off.
    """
    if not drives:
        return "", ""
    if all(drive == DriveState.ACTIVE for drive in drives):
        return "on", "released"
    if all(drive == DriveState.OFF for drive in drives):
        return "off", "applied"
    return "changing", "changing"
