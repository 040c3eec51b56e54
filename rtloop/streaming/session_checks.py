"""Checks that a session request is valid for this robot. They are needed because any client may write to
shared memory.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.ipc.session_rules import MAX_DECIMATION, damping_flaw, stiffness_flaw
from cobot.robot.device import WORDS, Capabilities
from cobot.servo.protocol import MAX_WATCHDOG_S
from rtloop.backends import Backend, GuidedByHand, ImpedanceControlled, capabilities_of
from rtloop.results import ACCEPTED, Accepted, Rejected, first_rejection, result_of

UNIT_TOLERANCE = 1e-2


def check_session(request: np.ndarray, backend: Backend, name: str) -> Accepted | Rejected:
    """Check that a session request, a record of `cobot.ipc.layout.session_dtype`, is valid for this robot.

    Args:
        name: name of the backend, for messages.
    """
    return first_rejection(_results(request, backend, name))


def _results(request: np.ndarray, backend: Backend, name: str) -> Iterator[Accepted | Rejected]:
    """Yield the result of each check. A check may rely on the checks before it."""
    yield _check_stream(request, capabilities_of(backend), name)
    yield _check_servo(request)
    yield _check_capabilities(request, capabilities_of(backend), name)
    if request["stream"] == Stream.GUIDED and not isinstance(backend, GuidedByHand):
        yield Rejected(f"the device of the backend {name} cannot release the arm for hand guiding by itself")
    yield _check_stiffness(request, backend)
    for field in ("damping_ratio", "cartesian_damping_ratio"):
        yield result_of(damping_flaw(field, request[field]))
    for field in ("max_contact_torque", "max_contact_wrench"):
        yield _check_positive(field, request)
    yield _check_force_frame(request)
    yield _check_positive("force_velocity", request)


def _check_stream(request: np.ndarray, device: Capabilities, name: str) -> Accepted | Rejected:
    if int(request["stream"]) not in list(Stream) or int(request["interpolation"]) not in list(Interpolation):
        return Rejected(
            f"there is no stream {request['stream']} with interpolation {request['interpolation']}"
        )
    if device.trajectories:
        return Rejected(
            f"a stream needs a device that takes a command in each cycle; the backend {name} takes "
            f"{WORDS['trajectories']}"
        )
    if not 1 <= request["decimation"] <= MAX_DECIMATION:
        return Rejected(f"decimation must be from 1 to {MAX_DECIMATION}, got {request['decimation']}")
    return ACCEPTED


def _check_positive(name: str, request: np.ndarray) -> Accepted | Rejected:
    if (request[name] > 0.0).all():
        return ACCEPTED
    return Rejected(f"{name} must be above 0, got {request[name].tolist()}")


def _check_force_frame(request: np.ndarray) -> Accepted | Rejected:
    frame = request["force_frame"]
    if np.isfinite(frame).all() and abs(float(np.linalg.norm(frame[3:])) - 1.0) < UNIT_TOLERANCE:
        return ACCEPTED
    return Rejected(f"force_frame must be a position and a unit quaternion, got {frame.tolist()}")


def _check_servo(request: np.ndarray) -> Accepted | Rejected:
    servo, stream = int(request["servo_mode"]), int(request["stream"])
    if servo == ServoMode.NONE:
        return ACCEPTED
    force = servo in (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)
    if servo not in list(ServoMode) or stream != (Stream.CARTESIAN if force else Stream.JOINT_IMPEDANCE):
        return Rejected(f"there is no servo mode {servo} of stream {stream}")
    if not 0.0 < request["watchdog_s"] <= MAX_WATCHDOG_S:
        return Rejected(
            f"watchdog_s must be above 0 and at most {MAX_WATCHDOG_S:g}, got {request['watchdog_s']}"
        )
    return ACCEPTED


def _check_capabilities(request: np.ndarray, device: Capabilities, name: str) -> Accepted | Rejected:
    """Check that the device has all capabilities that the session needs."""
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
    return next((Rejected(refusal) for refusal in refusals if refusal), ACCEPTED)


def _check_stiffness(request: np.ndarray, backend: Backend) -> Accepted | Rejected:
    if not isinstance(backend, ImpedanceControlled):
        return ACCEPTED
    for name, nominal in (
        ("stiffness", backend.nominal_stiffness),
        ("cartesian_stiffness", backend.nominal_cartesian_stiffness),
    ):
        if refusal := stiffness_flaw(name, request[name], nominal):
            return Rejected(refusal)
    return ACCEPTED
