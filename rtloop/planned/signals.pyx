"""The signals of the current motion: conditions, and actions that fire at a path time.

The slot of the trajectory contains them, and a block of shared memory reports their results. Each action
fires once, in the first cycle that has reached its path time.
"""

from cobot.arrays cimport doubles
from cobot.ipc.seqlock cimport Block
from cobot.robot.chain cimport Chain
from rtloop.planned.conditions cimport CycleCondition

import numpy as np

from cobot.ipc.layout import REASON, Firing, Waiting, text
from cobot.ipc.shm import encoded
from cobot.reasons import Reason, ReasonCode
from cobot.types import MAX_ACTIONS
from rtloop.results import ACCEPTED, Rejected

CONDITIONS = ("start_when", "pause_while", "until")
CONTINUING = CONDITIONS[1:]  # the conditions that apply to a motion that has begun
REASON_BYTES = np.dtype(REASON).itemsize
assert MAX_ACTIONS == CAPACITY


cdef class Signals:
    """The signals of one motion at a time.

    Attributes:
        active: whether the motion has any signals to process.
        waiting: whether the motion is waiting for `start_when`.
        paused: whether `pause_while` is met.
        met: whether `until` was met.
        fast: whether each joint then stops as fast as its limits permit.
    """

    def __init__(self, Chain chain, Block report, device):
        """
        Args:
            chain: kinematic chain of the arm, with the tool's TCP.
            report: block of shared memory for the report.
            device: the `rtloop.device.DeviceWatch` that sets outputs and reads inputs.
        """
        self._chain, self._report, self._device = chain, report, device
        self.start_when, self.pause_while, self.until = (
            CycleCondition(chain, device.read_input) for _ in range(3)
        )
        self.active = self.waiting = self.paused = self.met = self.fast = False
        self._count = self._next = 0
        self._offset_s = 0.0

    def begin(self, motion_id, record):
        """Set the signals of a motion that begins.

        Args:
            record: record of the type `cobot.ipc.layout.SIGNALS`, from the slot.

        Raises:
            ValueError: the record is invalid.
        """
        self.active = self.waiting = self.paused = self.met = False
        self._count = self._next = 0
        self._offset_s = 0.0
        self.start_when.active = self.pause_while.active = self.until.active = False
        if not (record["count"] or any(record[name]["quantity"] for name in CONDITIONS)):
            return
        self._require_order(record)
        for name in CONDITIONS:
            getattr(self, name).set(record[name])
        self._take_actions(record)
        self.fast, self.waiting, self.active = bool(record["fast"]), self.start_when.active, True
        self._clear_report(motion_id)
        self._report.data["waiting"] = self._waits()
        self._list_actions()
        self._report.publish()

    def continue_with(self, motion_id, record, double offset_s):
        """Set the signals of the trajectory with which the motion continues. Actions that have fired do not
        fire again, and an unchanged condition keeps its zero and its edge. `start_when` does not change.

        Args:
            offset_s: path time at which that trajectory begins.

        Raises:
            ValueError: the record is invalid.
        """
        self._require_order(record)
        for name in CONTINUING:
            getattr(self, name).continue_with(record[name])
        self.fast = bool(record["fast"])
        self._offset_s += offset_s
        known = self._report.data.copy()
        fired = {int(known["numbers"][row]): row for row in range(self._next)}
        self._take_actions(record)
        self.active = (
            self._count > 0
            or self.waiting
            or self.paused
            or self.pause_while.active
            or self.until.active
        )
        if not self.active:
            return
        if int(known["motion_id"]) != motion_id:
            self._clear_report(motion_id)
        numbers = self._record["numbers"].tolist()
        self._reorder(sorted(range(self._count), key=lambda row: numbers[row] not in fired))
        self._list_actions()
        report = self._report.data
        for row in range(self._count):
            before = fired.get(int(report["numbers"][row]))
            if before is None:
                break
            for name in ("firings", "path_times_s", "robot_times_s", "poses", "reasons"):
                report[name][row] = known[name][before]
            self._next = row + 1
        self._report.publish()

    def fire(self, position, double path_time_s, double robot_time_s):
        """Fire all actions that are due at a path time.

        Args:
            position: measured joint positions, shape (dof,), rad.

        Returns:
            `Rejected` if the motion must stop because the device has rejected an output.
        """
        report, done = self._report.data, ACCEPTED
        pose = np.zeros(7)
        self._chain.c_forward(doubles(position, self._chain.dof), doubles(pose, 7))
        while self.c_due(path_time_s):
            row = self._next
            self._next += 1
            firing, reason = Firing.FIRED, ""
            output = text(self._record["outputs"][row])
            if output:
                result = self._device.set_output(output, float(self._record["values"][row]))
                if isinstance(result, Rejected):
                    firing, reason = Firing.REJECTED, result.reason
            report["firings"][row], report["reasons"][row] = firing, encoded(reason, REASON_BYTES)
            report["path_times_s"][row] = self._offset_s + path_time_s
            report["robot_times_s"][row] = robot_time_s
            report["poses"][row] = pose
            if reason and self._record["stops"][row]:
                words = f"output {output} was rejected: {reason}"
                done = Rejected(Reason(words, ReasonCode.OUTPUT_REJECTED, of=(output,)))
                break
        self._report.publish()
        return done

    def end(self):
        """Stop checking, because the motion has ended."""
        self.active = self.met = False

    def publish(self):
        """Write the report to shared memory again."""
        self._report.publish()

    def _clear_report(self, motion_id):
        report = self._report.data
        report[...] = np.zeros((), report.dtype)
        report["motion_id"] = motion_id

    def _waits(self):
        return Waiting.START if self.waiting else Waiting.PAUSE if self.paused else Waiting.NO

    def _require_order(self, record):
        count, times_s = int(record["count"]), record["path_times_s"]
        if not count <= CAPACITY:
            raise ValueError(f"the motion has {count} actions, at most {CAPACITY} are possible")
        if not (np.isfinite(times_s[:count]).all() and (np.diff(times_s[:count]) >= 0.0).all()):
            raise ValueError("the path times of the motion's actions do not increase")
        numbers = record["numbers"][:count].tolist()
        if len(set(numbers)) != count:
            raise ValueError("two actions of the motion have the same number")

    def _take_actions(self, record):
        self._record = record.copy()
        self._reorder(range(int(record["count"])))

    def _reorder(self, order):
        rows, count = list(order), len(order)
        for name in ("path_times_s", "numbers", "outputs", "values", "stops"):
            self._record[name][:count] = self._record[name][rows]
        self._count, self._next = count, 0
        for row in range(count):
            self._path_times_s[row] = self._record["path_times_s"][row]

    def _list_actions(self):
        """Report all actions as pending."""
        report = self._report.data
        report["count"] = self._count
        report["numbers"][:self._count] = self._record["numbers"][:self._count]
        report["firings"] = Firing.PENDING

    cdef bint c_due(self, double path_time_s) noexcept nogil:
        """Whether an action is due at this path time."""
        return self._next < self._count and self._path_times_s[self._next] <= path_time_s

    cdef Verdict c_look(self, const double* measured, double path_time_s, double robot_time_s) except *:
        """Evaluate the conditions with the values measured in this cycle. Returns what they require."""
        cdef bint holds
        if self.waiting:
            if not self.start_when.c_holds(measured):
                return AS_BEFORE
            self.waiting = False
            self._tell()
            return BEGIN
        if self.until.c_watches(path_time_s) and self.until.c_holds(measured):
            self._meet(measured, path_time_s, robot_time_s)
            return END
        holds = self.pause_while.c_watches(path_time_s) and self.pause_while.c_holds(measured)
        if holds == self.paused:
            return AS_BEFORE
        self.paused = holds
        self._tell()
        return HOLD if holds else RESUME

    cdef void _meet(self, const double* measured, double path_time_s, double robot_time_s) except *:
        cdef double wrench[6]
        cdef double pose[7]
        self.until.c_relative(measured, wrench)
        self._chain.c_forward(measured, pose)
        self.met, self.paused = True, False
        report = self._report.data
        report["met"], report["waiting"] = 1, Waiting.NO
        report["met_path_time_s"] = self._offset_s + path_time_s
        report["met_robot_time_s"] = robot_time_s
        report["met_value"] = self.until.value
        report["met_wrench"] = [wrench[axis] for axis in range(6)]
        report["met_pose"] = [pose[axis] for axis in range(7)]
        self._report.publish()

    def _tell(self):
        self._report.data["waiting"] = self._waits()
        self._report.publish()
