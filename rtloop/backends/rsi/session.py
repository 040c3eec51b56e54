"""Evaluates the controller's telegrams: whether it accepts corrections, and whether the settings match it."""

from __future__ import annotations

import math

import numpy as np

from cobot.orientations import kuka_quaternion
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits, Pose
from rtloop.backends.agreement import check_agreement
from rtloop.backends.rsi.options import PERIODS_S, RsiOptions
from rtloop.backends.rsi.telegrams import RobState, TelegramLayout
from rtloop.results import ACCEPTED, Accepted, Rejected

HAND_GUARDED = ("T1", "T2")
"""Modes in which the operator must hold the enabling switch for a motion."""
OUTSIDE_RAD = 0.1
"""Maximum distance beyond the model's limits, rad or m. If it is larger, the configured arm or the unit must
be wrong.
"""


def check_readiness(state: RobState) -> Accepted | Rejected:
    """Check that the controller can move its drives. States that it does not report are assumed to be
    good.
    """
    if state.is_stopped:
        return Rejected(
            "an emergency stop or a safety stop is active ($ALARM_STOP): remove its cause, acknowledge it at "
            "the smartPAD, and start the program again"
        )
    if state.is_ready is False:
        switch = state.operation_mode in HAND_GUARDED
        return Rejected(
            f"the drives are off ($PERI_RDY); the operation mode is {state.operation_mode}"
            + (": press the enabling switch" if switch else "")
            + " and start the program again"
        )
    return ACCEPTED


def check_settings(
    state: RobState, step_ms: int, options: RsiOptions, period_s: float
) -> Accepted | Rejected:
    """Check that this controller can be used with these settings.

    Args:
        step_ms: increase of IPOC from one packet to the next, ms; 0 if unknown.
    """
    wanted_ms = round(period_s * 1e3)
    if step_ms and step_ms != wanted_ms:
        mode = PERIODS_S.get(step_ms * 1e-3, "a mode that RSI does not have")
        return Rejected(
            f"the controller's IPOC grows by {step_ms} ms ({mode}), but rt.period_s is {period_s:g} s "
            f"({PERIODS_S[period_s]}): change rt.period_s, or the second argument of RSI_ON in its "
            "program"
        )
    if state.mode and state.mode != options.correction:
        return Rejected(
            f"the controller's program says that its corrections are {state.mode}, but "
            f"robot.backend.correction is {options.correction}: change one of them, and the argument of "
            "RSI_ON with it"
        )
    if not state.correction and state.delay is None:
        return Rejected(
            "the telegram has neither AxisCorrMon nor Delay, so the current correction is not known: "
            "add DEF_Delay to the Ethernet configuration, or use the configuration that `cobot backend "
            "files rsi` writes"
        )
    if options.correction == "relative" and not (state.setpoint and state.delay is not None):
        return Rejected(
            "relative corrections need DEF_ASPos and DEF_Delay in the Ethernet configuration, because cobot "
            "cannot compensate lost answers without them"
        )
    return ACCEPTED


def check_position(state: RobState, layout: TelegramLayout, limits: JointLimits) -> Accepted | Rejected:
    """Check that the reported position is possible for this arm."""
    position = np.array(state.position)
    outside = np.maximum(limits.min_position - position, position - limits.max_position)
    joint = int(np.argmax(outside))
    if outside[joint] <= OUTSIDE_RAD:
        return ACCEPTED
    unit = "mm" if layout.scale[joint] == 1e3 else "degrees"
    low, high, here = (
        each[joint] * layout.scale[joint] for each in (limits.min_position, limits.max_position, position)
    )
    return Rejected(
        f"{layout.axes[joint]} ({limits.names[joint]}) is reported at {here:.2f} {unit}, but the "
        f"model's limits are {low:.2f} and {high:.2f} {unit}: this is another robot, robot.backend.axes "
        "has another order, or the units differ"
    )


def check_entry(
    state: RobState, options: RsiOptions, layout: TelegramLayout, held: Array
) -> Accepted | Rejected:
    """Check that the arm is at its commanded position. Only then may corrections begin."""
    off = np.abs(np.subtract(state.position, held))
    joint = int(off.argmax())
    if off[joint] <= options.entry_rad:
        return ACCEPTED
    return Rejected(
        f"{layout.axes[joint]} is {off[joint]:.4f} rad (or m) from the controller's set position, "
        f"allowed: {options.entry_rad:g} (robot.backend.entry_rad)"
    )


def check_flange(model: RobotModel, state: RobState) -> Accepted | Rejected:
    """Check that the reported pose equals the pose of the model's flange. The two are comparable because the
    controller's program selects $NULLFRAME as tool and base.
    """
    if len(state.pose) != 6 or not any(state.pose):
        return ACCEPTED
    position = 1e-3 * np.array(state.pose[:3])
    flange = Pose(position, np.array(kuka_quaternion(*map(math.radians, state.pose[3:]))))
    return check_agreement(model, np.array(state.position), flange)


def position_at_rest(state: RobState) -> tuple[float, ...]:
    """Return the controller's set position, or the measured position if it reports no set position."""
    return state.setpoint or state.position
