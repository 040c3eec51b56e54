"""The device status, derived from the controller's data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from cobot.robot.device import DeviceStatus
from rtloop.backends.ur.fields import FREEDRIVE_BUTTON, SafetyMode, UrRobotMode
from rtloop.backends.ur.words import hindrance, mode_in_words


def status_of(
    data: Mapping[str, Any], own_texts: Iterable[str], *, is_silent: bool, packages_lost: int
) -> DeviceStatus:
    """
    Args:
        data: the values of an RTDE package.
        own_texts: texts of the backend, which precede the controller's; "" for none.
    """
    mode, safety = data["robot_mode"], data.get("safety_status", data["safety_mode"])
    return DeviceStatus(
        connection="SILENT" if is_silent else "connected",
        safety_stop=hindrance(safety),
        drives=mode_in_words(mode),
        brakes="released" if mode in (UrRobotMode.RUNNING, UrRobotMode.BACKDRIVE) else "applied",
        speed_scaling=_speed_scaling(data),
        packets_lost=packages_lost,
        device_time_s=data["timestamp"],
        text="; ".join(filter(None, (*own_texts, *_texts(data)))),
    )


def _texts(data: Mapping[str, Any]) -> Iterator[str]:
    if data["safety_mode"] == SafetyMode.REDUCED:
        yield "reduced mode: the controller permits less speed and force"
    if data.get("robot_status_bits", 0) & FREEDRIVE_BUTTON:
        yield "the freedrive button is pressed"
    if data["target_speed_fraction"] < 1.0:
        yield f"the speed slider is at {100.0 * data['target_speed_fraction']:.0f} %"


def _speed_scaling(data: Mapping[str, Any]) -> float:
    """Return the speed scaling: the speed slider times the controller's own reduction."""
    share = data["speed_scaling"] * data["target_speed_fraction"]
    return min(max(float(share), 0.0), 1.0) if math.isfinite(share) else 0.0
