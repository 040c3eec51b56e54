"""Checks of a backend whose device has no faults."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from cobot.contract_checks import ContractError, NotTested
from cobot.ipc.layout import MotionResult, Stream
from cobot.ipc.state_fields import MEASURED_NAMES
from cobot.robot.device import STATUS_WORDS, DeviceStatus
from cobot.types import Array, LoopMode
from rtloop.backends import BackendError, GuidedByHand, Measured, Reporting, capabilities_of
from rtloop.contract.cell import REST_S, CheckedBackend
from rtloop.contract.driver import Driver
from rtloop.contract.stream import end_session, open_session
from rtloop.results import ACCEPTED

HELD_RAD = 1e-3
"""Maximum distance of the first command from the measured position, rad."""
FOLLOWED_RAD = 0.05
"""Maximum distance of an arm at rest from its commanded position, rad."""
SLACK = 1.0 + 1e-6
STOPPED = (MotionResult.STOPPED, MotionResult.STOPPED_ASIDE)
MODES = ("", "T1", "T2", "AUT")
FADED_S = 1.5
"""Maximum time in which an initial offset between the position and the command is removed, s."""
MAX_LAG = 4


def calls(cell: CheckedBackend) -> str:
    """The backend is opened, read, enabled, driven, disabled and closed without an error."""
    with cell.drive() as driver:
        driver.run(REST_S)
        heard = driver.heard
        driver.end()
    if [heard.calls[0], *heard.calls[-2:]] != ["open", "disable", "close"]:
        raise ContractError(
            "the first call must be open and the last two disable and close; the calls were "
            f"{', '.join(heard.calls)}"
        )
    if heard.calls.index("read") > heard.calls.index("write"):
        raise ContractError("write was called before read")
    return f"{len(heard.commands)} commands between open and close"


def values(cell: CheckedBackend) -> str:
    """`read` writes finite values into the given arrays, for each quantity that the capabilities declare."""
    rows = capabilities_of(cell.kind).measured
    with cell.drive() as driver:
        backend = driver.backend
        found = Measured(cell.robot.limits.dof)
        for name in rows:
            getattr(found, name)[:] = np.nan
        buffer = found.values
        driver.step()
        backend.read(found)
        if found.values is not buffer:
            raise ContractError("read must write to the arrays that it is given, but it has replaced them")
        for name in MEASURED_NAMES:
            if not np.isfinite(getattr(found, name)).all():
                raise ContractError(
                    f"{name} is claimed in capabilities.measured, but read does not fill it in completely: "
                    f"it is {getattr(found, name)}"
                )
        if "position" not in rows:
            raise ContractError(
                "capabilities.measured must contain position, because cobot cannot control an arm without it"
            )
        off = np.abs(found.position - driver.heard.commands[-1][0][0])
    joint = int(off.argmax())
    if not off[joint] <= FOLLOWED_RAD:
        raise ContractError(
            f"at rest, {cell.robot.limits.names[joint]} is measured {off[joint]:.3f} rad away from its "
            f"command, allowed: {FOLLOWED_RAD} rad: check units, signs and the order of the joints"
        )
    return ", ".join(name for name in MEASURED_NAMES if name in rows)


def status(cell: CheckedBackend) -> str:
    """`status` returns a complete `DeviceStatus`."""
    with cell.drive() as driver:
        backend = driver.backend
        if not isinstance(backend, Reporting):
            raise NotTested("the backend has no status()")
        found = backend.status()
    if not isinstance(found, DeviceStatus):
        raise ContractError(f"status() returns a {type(found).__name__}; it must return a DeviceStatus")
    words = dataclasses.asdict(found)
    wrong = [name for name in STATUS_WORDS if not isinstance(words[name], str)]
    if wrong:
        raise ContractError(f"status().{wrong[0]} is {words[wrong[0]]!r}; it must be a string")
    if found.operation_mode not in MODES:
        raise ContractError(f"status().operation_mode is {found.operation_mode!r}; it must be one of {MODES}")
    if not (math.isfinite(found.speed_scaling) and 0.0 <= found.speed_scaling <= 1.0):
        raise ContractError(f"status().speed_scaling is {found.speed_scaling}; it must be from 0 to 1")
    return ", ".join(words[name] for name in STATUS_WORDS if words[name])


def motion(cell: CheckedBackend) -> str:
    """The arm executes a planned motion and arrives."""
    with cell.drive() as driver:
        before = driver.heard.measured.copy()
        driver.move()
        moved = float(np.abs(driver.heard.measured - before).max())
    return f"up to {moved:.2f} rad"


def guiding(cell: CheckedBackend) -> str:
    """The device releases the arm for hand guiding and then holds it again. After that the arm can move."""
    with cell.drive() as driver:
        if not isinstance(driver.backend, GuidedByHand):
            raise NotTested("the device does not release the arm by itself for hand guiding")
        open_session(driver, Stream.GUIDED)
        driver.run(REST_S)
        off = float(np.abs(driver.heard.commands[-1][0][0] - driver.heard.measured).max())
        end_session(driver)
        driver.until("the arm is held after hand guiding", lambda: driver.mode != LoopMode.JOINT_IMPEDANCE)
        driver.until("the arm rests after hand guiding", lambda: driver.mode != LoopMode.STOPPING)
        if driver.mode != LoopMode.HOLD:
            raise ContractError(
                f"after hand guiding the mode is {driver.mode.name} and not HOLD: {driver.reason}"
            )
        if not off <= HELD_RAD:
            raise ContractError(
                f"during hand guiding the command is {off:.4f} rad from the measured position, allowed: "
                f"{HELD_RAD} rad"
            )
        driver.move()
    return "held again, and moved"


def stop(cell: CheckedBackend) -> str:
    """A stop during a motion stops the arm and holds it there. After that the arm can move again."""
    with cell.drive() as driver:
        driver.begin_move()
        driver.run(REST_S)
        driver.stop()
        driver.until("the arm rests after a stop", lambda: driver.mode == LoopMode.HOLD)
        result = driver.loop.controller.motion_result
        if result not in STOPPED:
            raise ContractError(f"a stopped motion ended as {result.name}: {driver.reason}")
        off = float(np.abs(driver.heard.commands[-1][0][0] - driver.heard.measured).max())
        if not off <= FOLLOWED_RAD:
            raise ContractError(f"after a stop the arm is {off:.3f} rad from its commanded position")
        driver.move()
    return "on its path" if result == MotionResult.STOPPED else "away from its path"


def limits(cell: CheckedBackend) -> str:
    """Commands stay within the velocity, acceleration and jerk limits, both when they are written and when
    they reach the device.
    """
    if capabilities_of(cell.kind).trajectories:
        raise NotTested("the device executes motions by itself: its own controller keeps its limits")
    with cell.drive() as driver:
        written, sent = len(driver.heard.commands), len(driver.wire or ())
        driver.move()
        wire = driver.wire
        shares = require_limits(
            cell, "written commands", [each[0][0] for each in driver.heard.commands[written:]]
        )
        if wire is not None:
            shares = require_limits(cell, "commands sent to the device", wire[sent:])
    said = f"{shares[0]:.2f}, {shares[1]:.2f} and {shares[2]:.2f} of velocity, acceleration and jerk"
    return said if wire is not None else f"{said}; the rig does not record the commands to the device"


def require_limits(cell: CheckedBackend, what: str, positions: list[Array]) -> list[float]:
    """Return the highest velocity, acceleration and jerk in a series of positions, each as a share of its
    limit.

    Raises:
        ContractError: a limit is exceeded.
    """
    period_s, bounds = cell.settings.rt.period_s, cell.robot.limits
    shares = []
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        share = np.abs(np.diff(np.array(positions), order, axis=0)) / period_s**order
        share = share / getattr(bounds, f"max_{name}")
        cycle, joint = np.unravel_index(share.argmax(), share.shape)
        if not share[cycle, joint] <= SLACK:
            raise ContractError(
                f"{what}: the {name} of {bounds.names[joint]} is {share[cycle, joint]:.2f} times its limit "
                f"in cycle {cycle} of a motion"
            )
        shares.append(float(share[cycle, joint]))
    return shares


def staleness(cell: CheckedBackend) -> str:
    """A written command reaches the device in the same cycle."""
    with cell.drive() as driver:
        if driver.wire is None:
            raise NotTested("the backend's rig does not record the commands to the device")
        driver.run(FADED_S)
        written, sent = len(driver.heard.commands), len(driver.wire)
        driver.move()
        commands = np.array([each[0][0] for each in driver.heard.commands[written:]])
        wire = np.array(driver.wire[sent:])
    length = min(len(commands), len(wire)) - MAX_LAG
    off = [float(np.abs(wire[lag:][:length] - commands[:length]).max()) for lag in range(MAX_LAG + 1)]
    lag = int(np.argmin(off))
    if lag:
        raise ContractError(f"commands reach the device {lag} cycles after they were written")
    return f"up to {off[0]:.1e} rad from the written commands"


def entry(cell: CheckedBackend) -> str:
    """The first command equals the measured position, both at the start and after the backend is reopened."""
    with cell.drive() as driver:
        require_entry(cell, driver, 0)
        driver.move()
        driver.end()
        driver.start()
        require_entry(cell, driver, 0)
        driver.until("the arm is held", lambda: driver.mode == LoopMode.HOLD)
        driver.run(REST_S)
        driver.move()
    return "at the start and when it is opened again"


def require_entry(cell: CheckedBackend, driver: Driver, before: int) -> None:
    """Check that the command that follows the first `before` commands equals the measured position. Raises
    ContractError if it differs.
    """
    command, measured = driver.first_command(before)
    off = np.abs(command - measured)
    joint = int(off.argmax())
    if not off[joint] <= HELD_RAD:
        raise ContractError(
            f"the first command for {cell.robot.limits.names[joint]} is {off[joint]:.4f} rad from the "
            f"measured position, allowed: {HELD_RAD} rad"
        )


def restart(cell: CheckedBackend) -> str:
    """A new backend can take over a device that was not closed, for example because rtloop was killed."""
    with cell.drive() as driver:
        driver.begin_move()
        driver.run(REST_S)
        driver.start()
        require_entry(cell, driver, 0)
        for _ in range(20):
            if driver.mode == LoopMode.HOLD:
                break
            driver.reset()
            driver.run(REST_S)
        driver.move()
    return "and moves"


def reject_open(cell: CheckedBackend) -> str:
    """`open` itself reports a missing device as an error."""
    with cell.make_driver() as driver:
        if "disconnect" not in driver.rig.faults:
            raise NotTested("the backend's rig cannot inject the fault disconnect")
        driver.rig.inject("disconnect")
        try:
            driver.start()
            driver.run(REST_S)
        except BackendError as exc:
            said = str(exc)
        else:
            said = driver.reason if driver.mode == LoopMode.FAULT else ""
        if not said:
            raise ContractError("the backend opens, enables and accepts commands although no device answers")
        driver.end()
        driver.rig.clear("disconnect")
        driver.start()
        if driver.reset() != ACCEPTED:
            raise ContractError(
                f"the device is connected again, but the fault cannot be reset: {driver.reason}"
            )
        driver.until("the arm is held", lambda: driver.mode == LoopMode.HOLD)
        driver.move()
    return said


CHECKS: dict[str, Callable[[CheckedBackend], str]] = {
    "calls": calls,
    "values": values,
    "status": status,
    "motion": motion,
    "stop": stop,
    "guiding": guiding,
    "limits": limits,
    "staleness": staleness,
    "entry": entry,
    "restart": restart,
    "device away at open": reject_open,
}
