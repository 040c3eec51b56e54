"""The record in shared memory that describes a device: its capabilities and its status."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from types import MappingProxyType

import numpy as np

from cobot.foreign import plain_text
from cobot.ipc.layout import MAX_PERIODS, text
from cobot.ipc.state_fields import MEASURED_NAMES
from cobot.robot.device import (
    FLAGS,
    STATUS_WORDS,
    STOP_CATEGORIES,
    Capabilities,
    DeviceStatus,
)

UNABLE, DOES, CONFIRMS = range(3)
"""Support for a stop category: not available, commanded by cobot, or also confirmed by the device."""


@dataclass(frozen=True, slots=True)
class DeviceReport:
    """The report of rtloop about its device.

    Attributes:
        status: status of the device; None if the device reports none.
        share: current speed of planned motions, as a share from 0 to 1.
        unacknowledged: sentences with the reason why the speed is reduced until a user acknowledges them; ""
            if there is no reason.
        drives_off: whether a category 1 stop has switched the drives off; a reset switches them on.
    """

    capabilities: Capabilities
    status: DeviceStatus | None
    share: float
    unacknowledged: str
    drives_off: bool

    @property
    def words(self) -> dict[str, object]:
        """The device's current status as plain JSON values."""
        said = {} if self.status is None else asdict(self.status)
        own = {"unacknowledged": self.unacknowledged, "drives_off": self.drives_off}
        return {**said, "speed_share": self.share, **own}


def fill_capabilities(record: np.ndarray, capabilities: Capabilities) -> None:
    """Write capabilities into a record of `cobot.ipc.layout.DEVICE`."""
    record["periods_s"] = 0.0
    count = min(len(capabilities.periods_s), MAX_PERIODS)
    record["periods_s"][:count] = capabilities.periods_s[:count]
    measured = (name in capabilities.measured for name in MEASURED_NAMES)
    record["measured"] = sum(real << bit for bit, real in enumerate(measured))
    record["able"] = [getattr(capabilities, name) for name in FLAGS]
    record["stops"] = [
        (CONFIRMS if capabilities.stops[category] else DOES) if category in capabilities.stops else UNABLE
        for category in STOP_CATEGORIES
    ]
    record["hardware"], record["guides"] = capabilities.hardware, capabilities.guides


def fill_status(record: np.ndarray, status: DeviceStatus) -> None:
    """Write a status into a record of `cobot.ipc.layout.DEVICE`. Texts that are too long are cut off."""
    for name in STATUS_WORDS:
        size = record.dtype[name].itemsize
        word = plain_text(getattr(status, name), size).encode()
        record[name] = word[:size].decode("utf-8", "ignore").encode()
    record["speed_scaling"] = status.speed_scaling
    record["packets_lost"] = status.packets_lost
    record["device_time_s"] = np.nan if status.device_time_s is None else status.device_time_s
    record["says"] = 1


def device_of(record: np.ndarray) -> DeviceReport:
    """Read a record of `cobot.ipc.layout.DEVICE`.

    Raises:
        ValueError: the record is invalid.
    """
    bits = int(record["measured"])
    capabilities = Capabilities(
        periods_s=tuple(float(each) for each in record["periods_s"] if each > 0.0),
        measured=frozenset(name for bit, name in enumerate(MEASURED_NAMES) if bits >> bit & 1),
        stops=MappingProxyType(
            {
                category: bool(how == CONFIRMS)
                for category, how in zip(STOP_CATEGORIES, record["stops"], strict=True)
                if how != UNABLE
            }
        ),
        hardware=bool(record["hardware"]),
        guides=bool(record["guides"]),
        **{name: bool(able) for name, able in zip(FLAGS, record["able"], strict=True)},
    )
    status = None
    if record["says"]:
        device_time_s = float(record["device_time_s"])
        status = DeviceStatus(
            speed_scaling=float(record["speed_scaling"]),
            packets_lost=int(record["packets_lost"]),
            device_time_s=None if np.isnan(device_time_s) else device_time_s,
            **{name: text(record[name]) for name in STATUS_WORDS},
        )
    unacknowledged, off = text(record["unacknowledged"]), bool(record["drives_off"])
    return DeviceReport(capabilities, status, float(record["share"]), unacknowledged, off)
