"""Checks of a session request for this robot, because any client may write to shared memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.ipc.session_rules import MAX_DECIMATION, damping_flaw, stiffness_flaw
from cobot.robot.device import WORDS, Capabilities
from cobot.servo.protocol import LONGEST_WATCHDOG_S
from rtloop.backends import Backend, ImpedanceControlled, capabilities_of
from rtloop.results import ACCEPTED, Accepted, Rejected

UNIT_TOLERANCE = 1e-2


def check_session(request: np.ndarray, backend: Backend, name: str) -> Accepted | Rejected:
    """Whether a session request, a record of `cobot.ipc.layout.session_dtype`, suits this robot.

    Args:
        name: name of the backend, for people.
    """
    return next((Rejected(flaw) for flaw in _flaws(request, backend, name) if flaw), ACCEPTED)


def _flaws(request: np.ndarray, backend: Backend, name: str) -> Iterator[str]:
    """The result of each check, "" if it passes. A check may rely on those before it."""
    yield _stream_flaw(request, capabilities_of(backend), name)
    yield _servo_flaw(request)
    yield _unable(request, capabilities_of(backend), name)
    yield _stiffness_flaw(request, backend)
    for field in ("damping_ratio", "cartesian_damping_ratio"):
        yield damping_flaw(field, request[field])
    for field in ("max_contact_torque", "max_contact_wrench"):
        yield _positive_flaw(field, request)
    yield _force_frame_flaw(request)
    yield _positive_flaw("force_velocity", request)


def _stream_flaw(request: np.ndarray, device: Capabilities, name: str) -> str:
    if int(request["stream"]) not in list(Stream) or int(request["interpolation"]) not in list(Interpolation):
        return f"there is no stream {request['stream']} with interpolation {request['interpolation']}"
    if device.trajectories:
        return (
            f"a stream needs a device that takes a command in each cycle; the backend {name} takes "
            f"{WORDS['trajectories']}"
        )
    if not 1 <= request["decimation"] <= MAX_DECIMATION:
        return f"decimation must be from 1 to {MAX_DECIMATION}, got {request['decimation']}"
    return ""


def _positive_flaw(name: str, request: np.ndarray) -> str:
    return "" if (request[name] > 0.0).all() else f"{name} must be above 0, got {request[name].tolist()}"


def _force_frame_flaw(request: np.ndarray) -> str:
    frame = request["force_frame"]
    if np.isfinite(frame).all() and abs(float(np.linalg.norm(frame[3:])) - 1.0) < UNIT_TOLERANCE:
        return ""
    return f"force_frame must be a position and a unit quaternion, got {frame.tolist()}"


def _servo_flaw(request: np.ndarray) -> str:
    servo, stream = int(request["servo_mode"]), int(request["stream"])
    if servo == ServoMode.NONE:
        return ""
    force = servo in (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)
    if servo not in list(ServoMode) or stream != (Stream.CARTESIAN if force else Stream.JOINT_IMPEDANCE):
        return f"there is no servo mode {servo} of stream {stream}"
    if not 0.0 < request["watchdog_s"] <= LONGEST_WATCHDOG_S:
        return f"watchdog_s must be above 0 and at most {LONGEST_WATCHDOG_S:g}, got {request['watchdog_s']}"
    return ""


def _unable(request: np.ndarray, device: Capabilities, name: str) -> str:
    """What the session needs and the device lacks; "" if nothing."""
    torques = request["stream"] == Stream.JOINT_TORQUE
    force = bool(request["force_axes"].any())
    wrench = bool(np.isfinite(request["max_contact_wrench"]).any())
    soft = bool(request["stiffness"].any() or request["cartesian_stiffness"].any())
    feels = torques or bool(np.isfinite(request["max_contact_torque"]).any())
    needed = {
        "a stream of torques": (("torque",), torques),
        "force control": (("impedance", "wrench"), force),
        "a stiffness": (("impedance",), soft),
    }
    felt = {
        "a stream of torques" if torques else "max_contact_torque": ("external_effort", feels),
        "max_contact_wrench": ("wrench", wrench),
        "force control": ("wrench", force and device.impedance),  # other devices control the force themselves
    }
    refusals = [device.lacks(name, what, *flags) for what, (flags, asked) in needed.items() if asked]
    refusals += [device.does_not_measure(name, what, row) for what, (row, asked) in felt.items() if asked]
    return next((refusal for refusal in refusals if refusal), "")


def _stiffness_flaw(request: np.ndarray, backend: Backend) -> str:
    if not isinstance(backend, ImpedanceControlled):
        return ""
    for name, nominal in (
        ("stiffness", backend.nominal_stiffness),
        ("cartesian_stiffness", backend.nominal_cartesian_stiffness),
    ):
        if refusal := stiffness_flaw(name, request[name], nominal):
            return refusal
    return ""
