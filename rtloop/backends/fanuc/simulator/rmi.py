"""The controller's side of the Remote Motion Interface, which replies to requests."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from cobot.errors import LimitError
from cobot.robot.io_points import IoKind, IoPoint, require_number
from rtloop.backends.fanuc.joints import to_horizon
from rtloop.backends.fanuc.messages import AXES, PointType
from rtloop.backends.fanuc.points import ANALOG, is_output
from rtloop.backends.fanuc.rmi import number_of
from rtloop.backends.fanuc.simulator.controller import FanucController

MAX_LINE = 65_536
SERVO_OFF, NOT_PAUSED, UNKNOWN, WRONG_STATE = 2556935, 2556938, 2556941, 2556943
NO_SCHEDULE, BAD_VALUE, TAKEN, BAD_SEQUENCE, NO_PORT, NO_PROGRAM = (
    2556945,
    2556949,
    2556954,
    2556957,
    2556966,
    2556981,
)
SCHEDULES = 10
ALARMS = 5
PROGRAM = "STREAM_MOTN"
KINDS = ("Command", "Instruction", "Communication")
Fields = dict[str, Any]


class RmiAnswers:
    """Answers requests, in one session at a time.

    Attributes:
        session_port: port of the session; valid once a client has received its number.
        occupied: whether a client has a session.
    """

    def __init__(self, controller: FanucController, version: tuple[int, int] = (9, 0)) -> None:
        self._controller, self._version = controller, version
        self.session_port = 0
        self.occupied = False
        self._initialized = False
        self._next = 1
        self._schedule = 1
        self._registers: dict[int, float] = {}

    def greet(self, line: bytes) -> bytes:
        """Return the reply to a line on the well-known port."""
        request = self._read(line)
        asked = request.get("Communication")
        if asked not in ("FRC_Connect", "FRC_Connect_STMO"):
            return self._write({"Communication": "Unknown", "ErrorID": UNKNOWN})
        major, minor = self._version
        reply: Fields = {"Communication": asked, "ErrorID": TAKEN if self.occupied else 0}
        if not self.occupied:
            reply |= {"PortNumber": self.session_port, "MajorVersion": major, "MinorVersion": minor}
        return self._write(reply)

    def answer(self, line: bytes) -> bytes:
        """Return the reply to a line in a session; b"" if the line requires no reply."""
        request = self._read(line)
        for kind in KINDS:
            if kind in request:
                return self._reply(kind, request)
        return self._write({"Command": "Unknown", "ErrorID": UNKNOWN})

    def leave(self) -> None:
        """End the session of a client that has disconnected."""
        self.occupied = False

    def _reply(self, kind: str, request: Fields) -> bytes:
        name = request[kind]
        handlers: dict[str, Callable[[Fields], Fields | None]] = {
            "FRC_Initialize": self._initialize,
            "FRC_Abort": self._abort,
            "FRC_Reset": self._reset,
            "FRC_Continue": lambda _: {"ErrorID": NOT_PAUSED},
            "FRC_GetStatus": self._status,
            "FRC_GetExtStatus": self._extended,
            "FRC_ReadError": self._errors,
            "FRC_ReadJointAngles": self._joints,
            "FRC_ReadCartesianPosition": self._cartesian,
            "FRC_SetOverRide": self._override,
            "FRC_SetPayloadID": self._payload,
            "FRC_ReadIOPort": self._read_port,
            "FRC_WriteIOPort": self._write_port,
            "FRC_ReadDIN": lambda fields: self._read_port({**fields, "PortType": "DI"}),
            "FRC_WriteDOUT": self._write_digital,
            "FRC_ReadRegister": self._read_register,
            "FRC_WriteRegister": self._write_register,
            "FRC_Call": self._call,
            "FRC_Disconnect": self._disconnect,
        }
        handler = handlers.get(name) if isinstance(name, str) else None
        if handler is None:
            return self._write({kind: "Unknown", "ErrorID": UNKNOWN})
        found = handler(request)
        return b"" if found is None else self._write({kind: name, "ErrorID": 0, **found})

    def _initialize(self, _: Fields) -> Fields:
        if not self._controller.servo_ready:
            return {"ErrorID": SERVO_OFF}
        if self._controller.mode != "AUTO" or self._controller.program:
            return {"ErrorID": WRONG_STATE}
        self._initialized = True
        return {"GroupMask": 1}

    def _abort(self, _: Fields) -> Fields:
        self._controller.abort()
        self._initialized = False
        return {}

    def _reset(self, _: Fields) -> Fields:
        self._controller.reset()
        return {}

    def _status(self, _: Fields) -> Fields:
        controller = self._controller
        return {
            "ServoReady": int(controller.servo_ready),
            "TPMode": int(controller.mode != "AUTO"),
            "RMIMotionStatus": 0,
            "ProgramStatus": 0 if controller.program else 2,
            "SingleStepMode": 0,
            "NumberUTool": 1,
            "NumberUFrame": 0,
            "NextSequenceID": self._next,
            "Override": controller.override,
        }

    def _extended(self, _: Fields) -> Fields:
        controller = self._controller
        code = controller.alarms[0].split()[0] if controller.alarms else None
        return {
            "InMotion": 0,
            "DrivesPowered": int(controller.servo_ready),
            "GenOverride": controller.override,
            "SpeedClampLimit": 100.0,
            "ErrorCode": code,
            "ControlMode": "Remote" if controller.mode == "AUTO" else "Local",
        }

    def _errors(self, fields: Fields) -> Fields:
        count = fields.get("Count", 1)
        count = count if type(count) is int and 1 <= count <= ALARMS else 1
        texts = self._controller.alarms[:count] or ["No Error"]
        numbers = ["", *map(str, range(2, ALARMS + 1))]
        return {
            "Count": len(texts),
            **{f"ErrorData{n}": text for n, text in zip(numbers, texts, strict=False)},
        }

    def _joints(self, _: Fields) -> Fields:
        controller = self._controller
        relative = controller.arm.measured.position * controller.units.per_unit
        axes = to_horizon(relative.tolist()) if len(relative) > 2 else tuple(relative.tolist())
        filled = (*axes, *[0.0] * (AXES - len(axes)))
        angles = {f"J{number}": round(value, 3) for number, value in enumerate(filled, 1)}
        return {"TimeTag": controller.time_ms, "JointAngle": angles}

    def _cartesian(self, _: Fields) -> Fields:
        names = ("X", "Y", "Z", "W", "P", "R", "Ext1", "Ext2", "Ext3")
        pose = (*self._controller.face_plate(), 0.0, 0.0, 0.0)
        frames = {"UToolNumber": 1, "UFrameNumber": 0, "Front": 1, "Up": 1, "Left": 0, "Flip": 1}
        return {
            "TimeTag": self._controller.time_ms,
            "Configuration": {**frames, "Turn4": 0, "Turn5": 0, "Turn6": 0},
            "Position": {name: round(value, 3) for name, value in zip(names, pose, strict=True)},
        }

    def _override(self, fields: Fields) -> Fields:
        value = fields.get("Value")
        if type(value) is not int or not 1 <= value <= 100:
            return {"ErrorID": BAD_VALUE}
        self._controller.override = value
        return {}

    def _payload(self, fields: Fields) -> Fields:
        number = fields.get("ScheduleNumber")
        if type(number) is not int or not 1 <= number <= SCHEDULES:
            return {"ErrorID": NO_SCHEDULE}
        self._schedule = number
        return {}

    def _read_port(self, fields: Fields) -> Fields:
        name = _point(fields)
        if name not in self._controller.io:
            return {"ErrorID": NO_PORT}
        port = {key: fields[key] for key in ("PortType", "PortNumber")}
        return {**port, "PortValue": self._controller.io[name]}

    def _write_port(self, fields: Fields) -> Fields:
        name, value = _point(fields), number_of(fields.get("PortValue"))
        if name not in self._controller.io or not is_output(PointType[name.partition("[")[0]]):
            return {"ErrorID": NO_PORT}
        if not _fits(name, value):
            return {"ErrorID": BAD_VALUE}
        self._controller.io[name] = int(value)
        return {key: fields[key] for key in ("PortType", "PortNumber")}

    def _write_digital(self, fields: Fields) -> Fields:
        value = {"ON": 1, "OFF": 0}.get(str(fields.get("PortValue")))
        found = self._write_port({**fields, "PortType": "DO", "PortValue": value})
        return {key: found[key] for key in found if key == "ErrorID"}

    def _read_register(self, fields: Fields) -> Fields:
        number = fields.get("RegisterNumber")
        if type(number) is not int or not 1 <= number <= 200:
            return {"ErrorID": BAD_VALUE}
        return {"RegisterNumber": number, "RegisterValue": self._registers.get(number, 0)}

    def _write_register(self, fields: Fields) -> Fields:
        number, value = fields.get("RegisterNumber"), number_of(fields.get("RegisterValue"))
        if type(number) is not int or not 1 <= number <= 200 or not math.isfinite(value):
            return {"ErrorID": BAD_VALUE}
        self._registers[number] = value
        return {}

    def _call(self, fields: Fields) -> Fields | None:
        """Call a program. The reply follows when the program ends, so this method only replies to errors."""
        sequence = fields.get("SequenceID")
        if not self._initialized:
            return {"ErrorID": WRONG_STATE, "SequenceID": sequence}
        if sequence != self._next:
            return {"ErrorID": BAD_SEQUENCE, "SequenceID": sequence}
        if fields.get("ProgramName") != PROGRAM:
            return {"ErrorID": NO_PROGRAM, "SequenceID": sequence}
        self._next += 1
        self._controller.call()
        return None

    def _disconnect(self, _: Fields) -> Fields:
        self._next = 1
        self._initialized = False
        self.leave()
        return {}

    @staticmethod
    def _read(line: bytes) -> Fields:
        try:
            found = json.loads(line)
        except (ValueError, RecursionError):
            found = None
        return found if isinstance(found, dict) else {}

    @staticmethod
    def _write(reply: Fields) -> bytes:
        return json.dumps(reply).encode() + b"\r\n"


def _point(fields: Fields) -> str:
    kind = "F" if fields.get("PortType") == "FLAG" else fields.get("PortType")
    return f"{kind}[{fields.get('PortNumber')}]"


def _fits(name: str, value: float) -> bool:
    kind = IoKind.DIGITAL if PointType[name.partition("[")[0]] in ANALOG else IoKind.BOOLEAN
    try:
        require_number(IoPoint(name, kind, True, value), value)
    except LimitError:
        return False
    return value <= 0xFFFF
