"""The time until an arm behind ros2_control has a goal, and until it works again after a fault.

The controllers are rclpy's, in a process of their own; the same goals come from rclpy's action client in the
same run.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
from cobot_run import WAIT_S, answering, until
from dds_peers import own_domain
from jazzy_controllers import ACTION, JOINTS, Double, RunAtDouble, acknowledge, motion, rclpy_follows
from real_ros import built_packages, controller_packages

from benchmarks.table import Row, percentiles, row
from rtloop.backends import BackendError, Measured
from rtloop.backends.ros2_control import Ros2ControlArm

GOAL_S, CHANGE_RAD = 0.4, 0.02
FAULTS = ("abort", "replace", "inactive", "silent", "nan", "missing")
FAILS_S = 0.1


def ros2_control(goals: int) -> Iterator[Row]:
    """Answer times for goals, from the backend and over HTTP, and reset times."""
    prefix = built_packages(controller_packages())
    with own_domain() as domain:
        double = Double(domain, prefix)
        try:
            place = np.array(double.seen()["position"])
            points = motion(place, 0.0, GOAL_S)
            wish = {"joints": JOINTS, "points": [[float(t), place.tolist()] for t in points[1]]}
            bare = [
                1e3 * each["accepted_s"]
                for each in rclpy_follows(double, ACTION, [{**wish, "repeat": goals}])
            ]
            floor = "rclpy's action client with the same goals"
            arm = double.arm(connect_s=20.0)
            arm.open(np.zeros(7))
            try:
                answers = [1e3 * _answer_s(arm) for _ in range(goals)]
                yield row(
                    "a goal of the backend, until the answer",
                    "ms",
                    percentiles(answers),
                    floor,
                    percentiles(bare),
                )
                resets = [1e3 * _reset_s(arm, double, fault) for fault in FAULTS]
            finally:
                arm.close()
            for fault, took in zip(FAULTS, resets, strict=True):
                yield row(f"reset after {fault}", "ms", (took,) * 3, floor, percentiles(bare))
            with (
                tempfile.TemporaryDirectory() as folder,
                answering(RunAtDouble(Path(folder), double)) as run,
                httpx.Client(base_url=run.url, timeout=WAIT_S) as http,
            ):
                acknowledge(run)
                taken = [1e3 * _request_s(http, double, place, number) for number in range(goals)]
            yield row(
                "POST /robot/move/joints, until the controller has accepted the goal",
                "ms",
                percentiles(taken),
                floor,
                percentiles(bare),
            )
        finally:
            double.kill()


def _answer_s(arm: Ros2ControlArm) -> float:
    """The time until a goal is answered. The goal is then executed."""
    measured = Measured(7)
    arm.state(measured)
    path, times_s, rows = motion(measured.position.copy(), 0.0, GOAL_S)
    begun_s = time.monotonic()
    arm.load(times_s, rows)
    arm.start()
    took_s = time.monotonic() - begun_s
    while arm.progress() < path.duration_s:
        time.sleep(0.02)
        arm.state(measured)
    return took_s


def _reset_s(arm: Ros2ControlArm, double: Double, fault: str) -> float:
    """The time from the end of a fault's cause to the end of the reset."""
    measured = Measured(7)
    arm.state(measured)
    _, times_s, rows = motion(measured.position.copy(), CHANGE_RAD, 1.5)
    arm.load(times_s, rows)
    arm.start()
    time.sleep(FAILS_S)
    double.be(fault)

    def failed() -> bool:
        try:
            arm.state(measured)
        except BackendError:
            return True
        return False

    until(failed)
    double.be("good")
    begun_s = time.monotonic()

    def enabled() -> bool:
        try:
            arm.enable()
            arm.state(measured)
        except BackendError:
            return False
        return True

    until(enabled)
    return time.monotonic() - begun_s


def _request_s(http: httpx.Client, double: Double, place: np.ndarray, number: int) -> float:
    """The time from a request until the controller has accepted its goal."""
    joints = (place + CHANGE_RAD * (number % 2 * 2 - 1)).tolist()
    begun_s = time.monotonic()
    http.post("/robot/move/joints", json={"joints": joints, "speed": 1.0}).raise_for_status()
    return float(double.seen()["accepted_s"]) - begun_s
