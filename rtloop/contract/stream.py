"""A client that streams positions and runs in the same process as the cycle."""

from __future__ import annotations

import os

import numpy as np

from cobot.contract_checks import ContractError
from cobot.ipc.layout import Ack, Interpolation, ServoMode, Stream, text
from rtloop.backends import ImpedanceControlled
from rtloop.contract.driver import Driver

STREAMED_RAD, STREAM_S = 0.02, 0.3
"""Distance by which the stream moves each joint, rad, and the duration, s."""


def begin_stream(driver: Driver) -> None:
    """Open a session whose targets move the arm. Raises ContractError if the session is rejected."""
    open_session(driver, Stream.JOINT_IMPEDANCE)
    session, block = driver.memory.session.data, driver.memory.setpoint
    start = driver.heard.commands[-1][0][0]
    goal = start + np.sign(driver.middle - start) * STREAMED_RAD
    for share in np.linspace(0.0, 1.0, round(STREAM_S / driver.period_s)):
        block.data["session"], block.data["number"] = session["number"], block.data["number"] + 1
        block.data["joints"] = start + share**2 * (goal - start)
        block.publish()
        driver.step()


def open_session(driver: Driver, stream: Stream) -> None:
    """Open a session. Raises ContractError if it is rejected."""
    memory = driver.memory
    session, ack = memory.session.data, memory.session_ack
    session["number"] += 1
    _fill_in(session, driver, stream)
    memory.session.publish()
    driver.until(
        "rtloop answers a session",
        lambda: ack.try_read() and int(ack.data["session"]) == int(session["number"]),
    )
    if int(ack.data["result"]) != Ack.ACCEPTED:
        raise ContractError(f"rtloop rejects a streaming session: {text(ack.data['message'])}")


def end_session(driver: Driver) -> None:
    """End the session, as a client would."""
    driver.memory.session.data["open"] = 0
    driver.memory.session.publish()


def _fill_in(session: np.ndarray, driver: Driver, stream: Stream) -> None:
    session["open"], session["pid"] = 1, os.getpid()
    session["stops"] = driver.memory.requests.data["stops"]
    session["stream"], session["interpolation"] = stream, Interpolation.LINEAR
    session["decimation"] = 1
    session["stiffness"] = session["cartesian_stiffness"] = 0.0
    backend = driver.backend
    if isinstance(backend, ImpedanceControlled):
        session["stiffness"] = backend.nominal_stiffness
        session["cartesian_stiffness"] = backend.nominal_cartesian_stiffness
    session["damping_ratio"] = session["cartesian_damping_ratio"] = 0.7
    session["max_contact_torque"] = session["max_contact_wrench"] = np.inf
    session["force_axes"], session["force_velocity"] = 0.0, 1.0
    session["force_frame"] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    session["posture"], session["servo_mode"] = np.nan, ServoMode.NONE
