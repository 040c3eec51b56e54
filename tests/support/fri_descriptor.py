"""FRI's messages for Google's protobuf, made from the list of fields that the vendor publishes: the oracle of
our own codec.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

OPTIONAL, REQUIRED, REPEATED = 1, 2, 3
DOUBLE, UINT64, INT32, FIXED32, STRING, MESSAGE, UINT32, ENUM = 1, 4, 5, 7, 9, 11, 13, 14

ENUMS = {
    "SessionState": 5,
    "Quality": 4,
    "SafetyState": 4,
    "OperationMode": 3,
    "DriveState": 3,
    "ControlMode": 4,
    "CommandMode": 5,
    "OverlayType": 3,
    "IoType": 3,
    "IoDirection": 2,
}
"""Each counts from 0."""
MESSAGES: dict[str, list[tuple[str, int, int, int | str]]] = {
    "JointValues": [("value", 1, REPEATED, DOUBLE)],
    "TimeStamp": [("sec", 1, REQUIRED, UINT32), ("nanosec", 2, REQUIRED, UINT32)],
    "CartesianVector": [("element", 1, REPEATED, DOUBLE)],
    "Transformation": [
        ("name", 1, REQUIRED, STRING),
        ("element", 2, REPEATED, DOUBLE),
        ("timestamp", 3, OPTIONAL, "TimeStamp"),
    ],
    "IoValue": [
        ("name", 1, REQUIRED, STRING),
        ("type", 2, REQUIRED, "IoType"),
        ("direction", 3, REQUIRED, "IoDirection"),
        ("digitalValue", 4, OPTIONAL, UINT64),
        ("analogValue", 5, OPTIONAL, DOUBLE),
    ],
    "Header": [
        ("messageIdentifier", 1, REQUIRED, UINT32),
        ("sequenceCounter", 2, REQUIRED, UINT32),
        ("reflectedSequenceCounter", 3, REQUIRED, UINT32),
    ],
    "ConnectionInfo": [
        ("sessionState", 1, REQUIRED, "SessionState"),
        ("quality", 2, REQUIRED, "Quality"),
        ("sendPeriod", 3, OPTIONAL, UINT32),
        ("receiveMultiplier", 4, OPTIONAL, UINT32),
    ],
    "RobotInfo": [
        ("numberOfJoints", 1, OPTIONAL, INT32),
        ("safetyState", 2, OPTIONAL, "SafetyState"),
        ("driveState", 5, REPEATED, "DriveState"),
        ("operationMode", 6, OPTIONAL, "OperationMode"),
        ("controlMode", 7, OPTIONAL, "ControlMode"),
    ],
    "MonitorData": [
        ("measuredJointPosition", 1, OPTIONAL, "JointValues"),
        ("measuredTorque", 2, OPTIONAL, "JointValues"),
        ("commandedJointPosition", 3, OPTIONAL, "JointValues"),
        ("commandedTorque", 4, OPTIONAL, "JointValues"),
        ("externalTorque", 5, OPTIONAL, "JointValues"),
        ("externalForce", 6, OPTIONAL, "CartesianVector"),
        ("readIORequest", 8, REPEATED, "IoValue"),
        ("measuredCartesianPose", 9, OPTIONAL, "Transformation"),
        ("timestamp", 15, OPTIONAL, "TimeStamp"),
    ],
    "IpoData": [
        ("jointPosition", 1, OPTIONAL, "JointValues"),
        ("cartesianPose", 2, OPTIONAL, "Transformation"),
        ("clientCommandMode", 10, OPTIONAL, "CommandMode"),
        ("overlayType", 11, OPTIONAL, "OverlayType"),
        ("trackingPerformance", 12, OPTIONAL, DOUBLE),
    ],
    "CommandData": [
        ("jointPosition", 1, OPTIONAL, "JointValues"),
        ("cartesianWrenchFeedForward", 2, OPTIONAL, "CartesianVector"),
        ("jointTorque", 3, OPTIONAL, "JointValues"),
        ("commandedTransformations", 4, REPEATED, "Transformation"),
        ("writeIORequest", 5, REPEATED, "IoValue"),
    ],
    "FrameLength": [("value", 1, REQUIRED, FIXED32)],
    "Checksum": [("crc32", 1, OPTIONAL, INT32)],
    "EndOf": [("messageLength", 1, OPTIONAL, INT32), ("messageChecksum", 2, OPTIONAL, "Checksum")],
    "FRIMonitoringMessage": [
        ("header", 1, REQUIRED, "Header"),
        ("robotInfo", 2, OPTIONAL, "RobotInfo"),
        ("monitorData", 3, OPTIONAL, "MonitorData"),
        ("connectionInfo", 4, OPTIONAL, "ConnectionInfo"),
        ("ipoData", 5, OPTIONAL, "IpoData"),
        ("requestedTransformations", 6, REPEATED, "Transformation"),
        ("endOfMessageData", 15, OPTIONAL, "EndOf"),
    ],
    "FRICommandMessage": [
        ("header", 1, REQUIRED, "Header"),
        ("commandData", 2, OPTIONAL, "CommandData"),
        ("endOfMessageData", 15, OPTIONAL, "EndOf"),
    ],
}


def fri_messages(*, packed: bool = False) -> Any:
    """Classes `FRIMonitoringMessage`, `FRICommandMessage` and `FrameLength`, a fixed32 in a message.

    packed: whether the rows of doubles are packed, which a controller does not do.
    """
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    package = "packed" if packed else "unpacked"
    file = descriptor_pb2.FileDescriptorProto(name=f"fri_{package}.proto", package=package, syntax="proto2")
    for name, count in ENUMS.items():
        enum = file.enum_type.add(name=name)
        for number in range(count):
            enum.value.add(name=f"{name}_{number}", number=number)
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        for field, number, label, kind in fields:
            added = message.field.add(name=field, number=number, label=label)
            if isinstance(kind, str):
                added.type = ENUM if kind in ENUMS else MESSAGE
                added.type_name = f".{package}.{kind}"
            else:
                added.type = kind
            if label == REPEATED and (kind == DOUBLE or kind in ENUMS):
                added.options.packed = packed
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return SimpleNamespace(
        **{
            name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{package}.{name}"))
            for name in ("FRIMonitoringMessage", "FRICommandMessage", "FrameLength")
        }
    )
