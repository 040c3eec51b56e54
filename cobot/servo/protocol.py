"""The servo protocol: messages that clients send to /{robot}/joint_cmd, and the rules for the points in them.

Chapter 7 of the vendor's manual defines the rules. A message that violates a rule changes nothing. Rejections
are counted by reason, and the sentence of the newest rejection is kept. No message raises an error to the
client, and nothing in this module moves an arm.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from cobot.ipc.layout import ServoMode
from cobot.servo.fields import BrokenRule, Refusal, as_number, integer, number, parsed, shown, within

POSE_SIZE = 6
DEFAULT_WATCHDOG_S = 0.5
MIN_WATCHDOG_S = 0.05
MAX_WATCHDOG_S = 60.0
MAX_PERIOD_S = 1.0
MAX_TIME_S = 10.0
LOOKAHEAD_S = (0.03, 0.2)
GAIN = (100.0, 2000.0)
"""Ranges for the lookahead time, s, and for the gain, as in UR's servoj."""
DEFAULT_LOOKAHEAD_S, DEFAULT_GAIN = 0.1, 300.0
"""Defaults that are used if only one of the two is given, as in UR's servoj."""
POSITION_TOLERANCE_RAD = 1e-6
POINT_TYPES = {"joint": False, "cartesian": True, 0: False, 1: True}

log = logging.getLogger("cobot.servo")


@dataclass(frozen=True, slots=True)
class SetMode:
    """Begin a session. Mode 0 ends it. Times are in s."""

    mode: ServoMode
    watchdog_s: float
    send_period_s: float


@dataclass(frozen=True, slots=True)
class Stop:
    """End the session."""


@dataclass(frozen=True, slots=True)
class FjtControl:
    """Settings for the execution of FollowJointTrajectory goals. Fields that are missing in the message are
    None.

    Attributes:
        time_s, send_period_s: times in s; 0 means the default.
    """

    enable: bool | None = None
    mode: ServoMode | None = None
    time_s: float | None = None
    send_period_s: float | None = None


@dataclass(frozen=True, slots=True)
class Point:
    """A target point.

    Attributes:
        cartesian: whether the position is x, y, z, rx, ry, rz (m, rad, fixed axes) instead of joints (rad).
        lookahead_s, gain: parameters of the servo law; both are 0 without a servo law.
    """

    session_id: int | None
    point_id: int | None
    cartesian: bool
    position: tuple[float, ...]
    time_s: float
    lookahead_s: float
    gain: float


Message = SetMode | Stop | FjtControl | Point


class ServoRules:
    """The state of the protocol for one robot.

    Attributes:
        active: whether points are accepted.
        mode, send_period_s, watchdog_s: settings of the current or last session.
        owner: the only sender whose points are accepted; "" if any sender is accepted.
        session_id: the id that the session is locked to; None until a point contains one.
        point_id: id of the last accepted point.
        received, accepted: number of points since the session began.
        refused: number of rejected messages since the session began, by reason.
        last_refusal: sentence of the latest rejection.
        fjt: the latest settings from `fjt_control`.
    """

    def __init__(
        self,
        min_position: Sequence[float],
        max_position: Sequence[float],
        control_period_s: float,
        units: Sequence[str] = (),
    ) -> None:
        self.limit_positions(min_position, max_position)
        self._units = list(units) or ["rad"] * len(self._bounds)
        self._control_period_s = control_period_s
        self.fjt = FjtControl()
        self.last_refusal = ""
        self.refused: Counter[Refusal] = Counter()
        self.received = self.accepted = 0
        self.session_id: int | None = None
        self.point_id: int | None = None
        self.active = False
        self.owner = ""
        self.mode = ServoMode.NONE
        self.watchdog_s, self.send_period_s = DEFAULT_WATCHDOG_S, control_period_s

    def limit_positions(self, min_position: Sequence[float], max_position: Sequence[float]) -> None:
        """Limit joint positions to these ranges, rad or m."""
        self._bounds = list(zip(map(float, min_position), map(float, max_position), strict=True))

    def begin(self, request: SetMode, owner: str = "") -> None:
        """Begin a session: points are accepted, and counters start at zero."""
        self.active, self.owner = True, owner
        self.mode, self.watchdog_s, self.send_period_s = (
            request.mode,
            request.watchdog_s,
            request.send_period_s,
        )
        self.session_id = self.point_id = None
        self.received = self.accepted = 0
        self.refused.clear()
        self.last_refusal = ""

    def end(self) -> None:
        """End the session: points are no longer accepted."""
        self.active = False

    def refuse(self, kind: Refusal, sentence: str, count: int = 1) -> None:
        """Count rejected messages by the kind of rejection, and store the sentence of the latest one."""
        self.refused[kind] += count
        self.last_refusal = sentence

    def read(self, text: str) -> Message | None:
        """Parse a message; None if it is rejected. A point must still be accepted with `accept`."""
        try:
            return self._message(parsed(text))
        except BrokenRule as exc:
            self.refuse(exc.kind, str(exc))
            return None

    def accept(self, point: Point) -> None:
        """Register a point that was passed on. The next point must have a higher id and belong to the same
        session.
        """
        self.accepted += 1
        if self.session_id is None:
            self.session_id = point.session_id
        if point.point_id is not None:
            self.point_id = point.point_id

    def request(self, mode: int, watchdog_s: float, send_period_s: float) -> SetMode:
        """Create a checked session request. A watchdog of 0 means the default, and a period of 0 means the
        control period.

        Raises:
            BrokenRule: the mode does not exist, or a value is out of range.
        """
        if mode not in list(ServoMode):
            raise BrokenRule(Refusal.MODE, f"mode must be an integer from 0 to 7, got {mode}")
        watchdog_s = watchdog_s or DEFAULT_WATCHDOG_S
        if not 0.0 < watchdog_s <= MAX_WATCHDOG_S:
            raise BrokenRule(
                Refusal.VALUE,
                f"watchdog_timeout must be above 0 s, up to {MAX_WATCHDOG_S:g} s, got {watchdog_s:g}",
            )
        if watchdog_s < MIN_WATCHDOG_S:
            log.warning("watchdog_timeout is %g s; %g s or more is recommended", watchdog_s, MIN_WATCHDOG_S)
        return SetMode(ServoMode(mode), watchdog_s, self._period(send_period_s, "send_period"))

    def point(
        self,
        position: Sequence[float],
        *,
        cartesian: bool,
        time_s: float,
        lookahead_s: float,
        gain: float,
        owner: str = "",
    ) -> Point:
        """Create a checked point from numbers. It has no session and no id. For each parameter, 0 means the
        default.

        Args:
            owner: the sender, if the session accepts only points from this sender.

        Raises:
            BrokenRule: there is no session, or a value is invalid.
        """
        self.received += 1
        self._require_active(owner)
        values = self._position(list(position), cartesian=cartesian)
        return Point(None, None, cartesian, values, *self._timing(time_s, lookahead_s, gain))

    def _message(self, fields: dict[str, Any]) -> Message:
        kind = fields.get("type", "servo_point")
        if kind == "servo_point":
            self.received += 1
            return self._read_point(fields)
        if kind == "servo_control":
            return self._read_control(fields)
        if kind == "fjt_control":
            return self._read_fjt(fields)
        raise BrokenRule(
            Refusal.TYPE, f"type must be servo_control, servo_point or fjt_control, got {shown(kind)}"
        )

    def _read_control(self, fields: dict[str, Any]) -> SetMode | Stop:
        command = fields.get("command")
        if command == "stop":
            return Stop()
        if command != "set_mode":
            raise BrokenRule(Refusal.COMMAND, f"command must be set_mode or stop, got {shown(command)}")
        mode = integer(fields, "mode", Refusal.MODE)
        if mode is None:
            raise BrokenRule(Refusal.MODE, "mode is missing: an integer from 0 to 7")
        watchdog_s = number(fields, "watchdog_timeout", DEFAULT_WATCHDOG_S)
        if watchdog_s <= 0.0 and mode != ServoMode.NONE:
            raise BrokenRule(Refusal.VALUE, f"watchdog_timeout must be above 0 s, got {watchdog_s:g}")
        return self.request(mode, max(watchdog_s, 0.0), number(fields, "send_period", 0.0))

    def _read_fjt(self, fields: dict[str, Any]) -> FjtControl:
        enable = fields.get("enable", fields.get("enable_fjt_action", self.fjt.enable))
        if enable is not None and not isinstance(enable, bool):
            raise BrokenRule(Refusal.VALUE, f"enable must be true or false, got {shown(enable)}")
        mode = self.fjt.mode
        if (wanted := integer(fields, "fjt_mode", Refusal.MODE)) is not None:
            if wanted not in range(len(ServoMode)):
                raise BrokenRule(Refusal.MODE, f"fjt_mode must be an integer from 0 to 7, got {wanted}")
            mode = ServoMode(wanted)
        times = {}
        for name, longest, before in (
            ("fjt_time", MAX_TIME_S, self.fjt.time_s),
            ("fjt_send_period", MAX_PERIOD_S, self.fjt.send_period_s),
        ):
            times[name] = before
            if name in fields and fields[name] is not None:
                times[name] = max(within(number(fields, name, 0.0), longest, name), 0.0)
        return FjtControl(enable, mode, times["fjt_time"], times["fjt_send_period"])

    def _read_point(self, fields: dict[str, Any]) -> Point:
        self._require_active()
        point_id = integer(fields, "point_id", Refusal.POINT_ID)
        if point_id is None:
            raise BrokenRule(Refusal.NO_POINT_ID, "a point needs a point_id")
        if self.point_id is not None and point_id <= self.point_id:
            raise BrokenRule(
                Refusal.POINT_ID, f"point_id must increase: {point_id} comes after {self.point_id}"
            )
        session_id = integer(fields, "session_id", Refusal.SESSION_ID)
        if self.session_id is not None and session_id != self.session_id:
            raise BrokenRule(
                Refusal.SESSION_ID,
                f"session_id is {session_id}, but the session is locked to {self.session_id}",
            )
        named = fields.get("point_type", "joint")
        if isinstance(named, bool | float | list | dict) or named not in POINT_TYPES:
            raise BrokenRule(
                Refusal.POINT_TYPE, f"point_type must be joint or 0, cartesian or 1, got {shown(named)}"
            )
        cartesian = POINT_TYPES[named]
        position = self._position(fields.get("position"), cartesian=cartesian)
        timing = self._timing(
            number(fields, "time", 0.0), number(fields, "lookahead_time", 0.0), number(fields, "gain", 0.0)
        )
        return Point(session_id, point_id, cartesian, position, *timing)

    def _require_active(self, owner: str = "") -> None:
        if not self.active:
            raise BrokenRule(Refusal.NOT_ACTIVE, "there is no servo session: begin one with set_mode")
        if owner != self.owner:
            whose = self.owner or "another client"
            raise BrokenRule(Refusal.SESSION_ID, f"the servo session accepts only points of {whose}")

    def _position(self, position: object, *, cartesian: bool) -> tuple[float, ...]:
        size = POSE_SIZE if cartesian else len(self._bounds)
        if not isinstance(position, list) or len(position) != size:
            count = f"{len(position)} of them" if isinstance(position, list) else shown(position)
            what = "a pose" if cartesian else "this robot's joints"
            raise BrokenRule(Refusal.DIMENSION, f"position must be {size} numbers for {what}, got {count}")
        values = tuple([as_number(value, "position") for value in position])
        if not cartesian:
            for joint, (value, (low, high)) in enumerate(zip(values, self._bounds, strict=True), start=1):
                if not low - POSITION_TOLERANCE_RAD <= value <= high + POSITION_TOLERANCE_RAD:
                    raise BrokenRule(
                        Refusal.LIMIT,
                        f"joint {joint} must be from {low:g} to {high:g} {self._units[joint - 1]}, "
                        f"got {value:.6g}",
                    )
        return values

    def _timing(self, time_s: float, lookahead_s: float, gain: float) -> tuple[float, float, float]:
        """Time, lookahead time and gain, clipped to UR's ranges."""
        if time_s < 0.0:
            raise BrokenRule(Refusal.VALUE, f"time must be 0 s or more, got {time_s:g}")
        time_s = within(time_s, MAX_TIME_S, "time") or self.send_period_s
        if lookahead_s <= 0.0 and gain <= 0.0:
            return time_s, 0.0, 0.0
        lookahead_s = lookahead_s if lookahead_s > 0.0 else DEFAULT_LOOKAHEAD_S
        gain = gain if gain > 0.0 else DEFAULT_GAIN
        return (
            time_s,
            min(max(lookahead_s, LOOKAHEAD_S[0]), LOOKAHEAD_S[1]),
            min(max(gain, GAIN[0]), GAIN[1]),
        )

    def _period(self, value: float, name: str) -> float:
        if value <= 0.0:
            return self._control_period_s
        return max(within(value, MAX_PERIOD_S, name), self._control_period_s)
