"""Records of the actions and conditions of a motion in shared memory, and rtloop's report about them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cobot.ipc.layout import Firing, Waiting, text
from cobot.motions.signals import Condition, Placed, Quantity
from cobot.types import Array

ALWAYS = (0.0, math.inf)


@dataclass(frozen=True, slots=True)
class Fired:
    """The outcome of an action.

    Attributes:
        path_time_s, robot_time_s: path time, and time on the robot's clock, of the cycle in which the action
            fired, s.
        pose: TCP pose, measured in that cycle, shape (7,), m and (w, x, y, z), in the base frame.
        reason: the reason why the device rejects the action; "" if it does not reject it.
    """

    firing: Firing
    path_time_s: float
    robot_time_s: float
    pose: Array
    reason: str


@dataclass(frozen=True, slots=True)
class Met:
    """The cycle in which `until` was met.

    Attributes:
        value: the value that the condition compares.
        wrench: wrench at the TCP, in the base frame, shape (6,), N and N·m; the zero is subtracted.
        pose: see `Fired.pose`.
    """

    path_time_s: float
    robot_time_s: float
    value: float
    wrench: Array
    pose: Array


@dataclass(frozen=True, slots=True)
class SignalReport:
    """rtloop's report about the signals of a motion.

    Attributes:
        fired: outcomes of the actions by their numbers. Pending actions are left out.
        met: the cycle in which `until` was met; None if it has not been met.
    """

    motion_id: int
    waiting: Waiting
    fired: dict[int, Fired]
    met: Met | None


def fill_signals(record: np.ndarray, placed: Placed) -> None:
    """Write signals into a record of `cobot.ipc.layout.SIGNALS`."""
    count = record["count"] = len(placed.actions)
    for row, each in enumerate(placed.actions):
        action = each.action
        record["path_times_s"][row], record["numbers"][row] = each.path_time_s, each.number
        record["outputs"][row], record["values"][row] = action.output.encode(), action.value
        record["stops"][row] = action.stops_on_failure
    for name in ("path_times_s", "numbers", "outputs", "values", "stops"):
        record[name][count:] = np.zeros((), record[name].dtype)
    until = placed.until
    _fill_condition(record["start_when"], placed.start_when, ALWAYS)
    _fill_condition(record["pause_while"], placed.pause_while, placed.pause_s)
    _fill_condition(record["until"], None if until is None else until.condition, (placed.until_s, math.inf))
    record["fast"] = until is not None and until.fast


def _fill_condition(record: np.ndarray, condition: Condition | None, times_s: tuple[float, float]) -> None:
    if condition is None:
        record[...] = np.zeros((), record.dtype)
        return
    record["quantity"], record["joint"] = condition.quantity, condition.joint
    record["name"] = condition.name.encode() if condition.quantity is Quantity.INPUT else b""
    record["edge"], record["in_tool"] = condition.edge, condition.in_tool
    record["low"], record["high"] = condition.low, condition.high
    record["direction"] = np.nan if condition.direction is None else condition.direction
    record["zero"] = np.nan
    if condition.zero is not None:
        record["zero"][: len(condition.zero)] = condition.zero
    record["from_s"], record["to_s"] = times_s


def signal_report(record: np.ndarray) -> SignalReport:
    """Read a record of `cobot.ipc.layout.SIGNAL_REPORT`.

    Raises:
        ValueError: the record is invalid.
    """
    count = int(record["count"])
    if count > len(record["numbers"]):
        raise ValueError(f"a motion has {count} actions, allowed: {len(record['numbers'])}")
    fired = {}
    for row in range(count):
        firing = Firing(int(record["firings"][row]))
        if firing is not Firing.PENDING:
            fired[int(record["numbers"][row])] = Fired(
                firing,
                float(record["path_times_s"][row]),
                float(record["robot_times_s"][row]),
                record["poses"][row].copy(),
                text(record["reasons"][row]),
            )
    met = None
    if record["met"]:
        met = Met(
            float(record["met_path_time_s"]),
            float(record["met_robot_time_s"]),
            float(record["met_value"]),
            record["met_wrench"].copy(),
            record["met_pose"].copy(),
        )
    return SignalReport(int(record["motion_id"]), Waiting(int(record["waiting"])), fired, met)
