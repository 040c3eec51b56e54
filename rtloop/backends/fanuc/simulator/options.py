"""Options of a simulated controller."""

from __future__ import annotations

from dataclasses import dataclass, field

from rtloop.backends.fanuc.messages import MIN_VERSION

MODES = ("AUTO", "T1", "T2")


@dataclass(frozen=True, slots=True)
class FanucControllerOptions:
    """
    Attributes:
        version: newest version of Stream Motion that it supports.
        horizon: whether joint 3 in the stream is measured from the horizon.
        payload_share: share of the full payload for which the controller checks its limits, 0 to 1.
        table_share: the controller's limits at full payload and maximum speed, as a share of the model's
            limits.
        io: inputs and outputs that exist, with their values.
        lag_ms: delay of the reported joints.
        world_z_m: height of its world frame above the model's base.
    """

    period_ms: int = 8
    version: int = MIN_VERSION
    mode: str = "AUTO"
    horizon: bool = False
    payload_share: float = 0.0
    table_share: float = 1.0
    io: dict[str, int] = field(default_factory=dict)
    lag_ms: int = 0
    world_z_m: float = 0.0
