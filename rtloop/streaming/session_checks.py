"""Whether a streaming session makes sense for this robot: who writes to shared memory may write anything."""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.servo.protocol import LONGEST_WATCHDOG_S
from rtloop.backends import Backend, ImpedanceControlled

UNIT_TOLERANCE = 1e-2


def session_refusal(wish: np.ndarray, backend: Backend) -> str:
    """What is wrong with what a client wants, `cobot.ipc.layout.session_dtype`; "" if nothing is."""
    if int(wish["stream"]) not in list(Stream) or int(wish["interpolation"]) not in list(Interpolation):
        return f"there is no stream {wish['stream']} with interpolation {wish['interpolation']}"
    if not 1 <= wish["decimation"] <= 1000:
        return f"decimation must be from 1 to 1000, got {wish['decimation']}"
    if refusal := _servo_flaw(wish):
        return refusal
    if refusal := _stiffness_flaw(wish, backend):
        return refusal
    for name in ("damping_ratio", "cartesian_damping_ratio"):
        if not ((wish[name] >= 0.3) & (wish[name] <= 1.0)).all():
            return f"{name} must be from 0.3 to 1, got {wish[name].tolist()}"
    for name in ("max_contact_torque", "max_contact_wrench"):
        if not (wish[name] > 0.0).all():
            return f"{name} must be above 0, got {wish[name].tolist()}"
    turn = float(np.linalg.norm(wish["force_frame"][3:]))
    if not (np.isfinite(wish["force_frame"]).all() and abs(turn - 1.0) < UNIT_TOLERANCE):
        return f"force_frame must be a position and a unit quaternion, got {wish['force_frame'].tolist()}"
    if not (wish["force_velocity"] > 0.0).all():
        return f"force_velocity must be above 0, got {wish['force_velocity'].tolist()}"
    return ""


def _servo_flaw(wish: np.ndarray) -> str:
    servo, stream = int(wish["servo_mode"]), int(wish["stream"])
    if servo == ServoMode.NONE:
        return ""
    force = servo in (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)
    if servo not in list(ServoMode) or stream != (Stream.CARTESIAN if force else Stream.JOINT_IMPEDANCE):
        return f"there is no servo mode {servo} of stream {stream}"
    if not 0.0 < wish["watchdog_s"] <= LONGEST_WATCHDOG_S:
        return f"watchdog_s must be above 0 and at the most {LONGEST_WATCHDOG_S:g}, got {wish['watchdog_s']}"
    return ""


def _stiffness_flaw(wish: np.ndarray, backend: Backend) -> str:
    if not isinstance(backend, ImpedanceControlled):
        stiff = not wish["stiffness"].any() and not wish["cartesian_stiffness"].any()
        force = wish["stream"] == Stream.JOINT_TORQUE or wish["force_axes"].any()
        return "" if stiff and not force else "this robot's drives cannot give way: no stiffness, no force"
    for name, nominal in (
        ("stiffness", backend.nominal_stiffness),
        ("cartesian_stiffness", backend.nominal_cartesian_stiffness),
    ):
        values = wish[name]
        if not ((values > 0.0) & (values <= nominal)).all():
            return f"{name} must be above 0 and at the most {nominal.tolist()}, got {values.tolist()}"
    return ""
