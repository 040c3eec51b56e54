"""Checks with device faults. rtloop must report the reason of each fault, and a reset must recover from it
without a restart.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from cobot.contract_checks import ContractError, NotTested
from cobot.ipc.layout import Command, MotionResult
from cobot.types import LoopMode
from rtloop.backends import BackendError, Reporting, capabilities_of
from rtloop.contract.cell import REST_S, CheckedBackend
from rtloop.contract.checks import require_entry, require_limits
from rtloop.contract.driver import Driver
from rtloop.contract.stream import begin_stream
from rtloop.results import Rejected

ENDED = (LoopMode.FAULT, LoopMode.ESTOP)
MEANWHILE_S = 0.4
ENABLING_CYCLES = 2
MOTIONS_UNDER_LOSS = 3


def survives(fault: str, cell: CheckedBackend) -> str:
    """A motion continues despite lost or reordered packets, and no command exceeds the limits."""
    with cell.drive() as driver:
        _require(driver, fault)
        before = len(driver.heard.commands)
        with driver.fault(fault):
            for _ in range(MOTIONS_UNDER_LOSS):
                driver.move()
        require_limits(cell, "written commands", [each[0][0] for each in driver.heard.commands[before:]])
        if driver.mode != LoopMode.HOLD:
            raise ContractError(
                f"after the motions the mode is {driver.mode.name} and not HOLD: {driver.reason}"
            )
    return f"{MOTIONS_UNDER_LOSS} motions arrive"


def ends(fault: str, cell: CheckedBackend, *, moving: bool) -> str:
    """A fault during a motion, or while the arm is held, puts rtloop into FAULT, with a reason. No reset
    succeeds while the fault lasts. Afterwards the arm can move again.
    """
    return _inject_while(fault, cell, _move if moving else _rest, stays=True)


def while_stopping(fault: str, cell: CheckedBackend) -> str:
    """Like `ends`, but the fault occurs while the arm is stopping."""

    def stop(driver: Driver) -> None:
        _move(driver)
        driver.stop()
        driver.step(2)

    return _inject_while(fault, cell, stop, stays=False)


def in_stream(fault: str, cell: CheckedBackend) -> str:
    """Like `ends`, but the fault occurs while a client is streaming positions."""
    if capabilities_of(cell.kind).trajectories:
        raise NotTested("nothing can be streamed to a device that executes motions by itself")
    return _inject_while(fault, cell, begin_stream, stays=True)


def while_loading(fault: str, cell: CheckedBackend) -> str:
    """Like `ends`, but the fault occurs immediately after a motion was requested. The motion is rejected or
    ends.
    """
    with cell.drive() as driver:
        _require(driver, fault)
        driver.ask_move()
        with driver.fault(fault):
            said = _await_fault(driver, fault)
            driver.await_answer()
            result = driver.loop.controller.motion_result
            if result in (MotionResult.RUNNING, MotionResult.ARRIVED):
                raise ContractError(
                    f"{fault} while a motion is being loaded: the motion must be rejected or end, but "
                    f"it is {result.name}"
                )
        _require_recovery(cell, driver)
    return said


def while_enabling(fault: str, cell: CheckedBackend) -> str:
    """Like `ends`, but the fault occurs in the middle of a reset. The reset is rejected, or the fault is
    detected again.
    """
    with cell.drive() as driver:
        _require(driver, fault)
        with driver.fault(fault):
            said = _await_fault(driver, fault)
        driver.run(MEANWHILE_S)
        driver.ask(Command.RESET)
        driver.step(ENABLING_CYCLES)
        with driver.fault(fault):
            result = driver.await_answer()
            _await_fault(driver, fault)
            _require_lasting(driver, fault)
        _require_recovery(cell, driver)
    return result.reason if isinstance(result, Rejected) else said


def twice(fault: str, cell: CheckedBackend) -> str:
    """The fault occurs again during a recovery, before and after the reset."""
    with cell.drive() as driver:
        _require(driver, fault)
        with driver.fault(fault):
            said = _await_fault(driver, fault)
        driver.step(2)
        with driver.fault(fault):
            driver.run(MEANWHILE_S)
            _require_lasting(driver, fault)
        _require_recovery(cell, driver)
        with driver.fault(fault):
            _await_fault(driver, fault)
        _require_recovery(cell, driver)
    return said


def mode_change(cell: CheckedBackend) -> str:
    """The backend reports a change of the operation mode. The motion ends in a fault or continues, and the
    arm can move again.
    """
    with cell.drive() as driver:
        _require(driver, "operation_mode")
        backend = driver.backend
        before = backend.status().operation_mode if isinstance(backend, Reporting) else None
        driver.begin_move()
        driver.run(REST_S)
        with driver.fault("operation_mode"):
            driver.run(MEANWHILE_S)
            after = backend.status().operation_mode if isinstance(backend, Reporting) else None
            if before is not None and before == after:
                raise ContractError(
                    f"the operation mode has changed, but status().operation_mode is still {before!r}"
                )
            if driver.mode in ENDED and not driver.reason:
                raise ContractError(f"the mode is {driver.mode.name}, but no reason is reported")
            went_on = driver.mode not in ENDED
        running = MotionResult.RUNNING
        driver.until("a motion ends", lambda: driver.loop.controller.motion_result != running)
        _require_recovery(cell, driver)
    told = f"{before} to {after}: " if before is not None else ""
    return f"{told}{'the motion goes on' if went_on else 'the motion ends'}"


def _rest(driver: Driver) -> None:
    """Do nothing, so that the fault occurs while the arm is held at rest."""


def _move(driver: Driver) -> None:
    driver.begin_move()
    driver.run(REST_S)


def _inject_while(fault: str, cell: CheckedBackend, begin: Callable[[Driver], None], *, stays: bool) -> str:
    """Inject a fault after `begin`, and return the reported reason. If `stays` is true, the fault lasts
    through some resets.
    """
    with cell.drive() as driver:
        _require(driver, fault)
        begin(driver)
        with driver.fault(fault):
            said = _await_fault(driver, fault)
            if stays:
                _require_lasting(driver, fault)
        _require_recovery(cell, driver)
    return said


def _require(driver: Driver, fault: str) -> None:
    if fault not in driver.rig.faults:
        raise NotTested(f"the backend's rig cannot inject the fault {fault}")


def _await_fault(driver: Driver, fault: str) -> str:
    """Wait until rtloop reports the fault, and return the reported reason."""
    driver.until(f"{fault} is a fault", lambda: driver.mode in ENDED)
    if not driver.reason:
        raise ContractError(f"{fault}: the mode is {driver.mode.name}, but no reason is reported")
    return driver.reason


def _require_lasting(driver: Driver, fault: str) -> None:
    """Check that a reset is rejected, or that the fault is detected again, while the cause of the fault
    lasts.
    """
    driver.run(MEANWHILE_S)
    written = len(driver.heard.commands)
    try:
        driver.reset(attempts=2)
    except BackendError as exc:
        raise ContractError(f"{fault}: a reset raises an exception in the cycle: {exc}") from exc
    driver.run(MEANWHILE_S)
    if driver.mode not in ENDED:
        raise ContractError(
            f"{fault}: although the fault lasts, the mode after a reset is {driver.mode.name}"
        )
    for command, _ in driver.heard.commands[written:]:
        if not np.isfinite(command).all():
            raise ContractError(f"{fault}: a command is not finite")


def _require_recovery(cell: CheckedBackend, driver: Driver) -> None:
    """Check that a reset succeeds, that the command does not jump, and that the arm can move. The backend is
    not reopened.
    """
    driver.run(MEANWHILE_S)
    before = len(driver.heard.commands)
    result = driver.reset()
    if isinstance(result, Rejected):
        raise ContractError(
            f"the cause of the fault no longer exists, but a reset is rejected: {result.reason}"
        )
    driver.until("the arm is held", lambda: driver.mode == LoopMode.HOLD)
    sent = len(driver.wire or ())
    if driver.heard.calls.count("open") != 1:
        raise ContractError("the backend was opened again; a reset must work without this")
    require_entry(cell, driver, max(before, len(driver.heard.commands) - 1))
    driver.run(REST_S)
    if driver.mode != LoopMode.HOLD:
        raise ContractError(f"after a reset the mode changes to {driver.mode.name}: {driver.reason}")
    driver.move()
    if driver.wire is not None:
        require_limits(cell, "after a reset, commands sent to the device", driver.wire[sent:])


STOPPING = ("disconnect", "frozen", "nan", "e_stop", "protective_stop")
RESTING = ("disconnect", "nan", "e_stop", "protective_stop")
"""Faults that the checks inject while the arm is at rest: those of `STOPPING` except `frozen`, because the
values of an arm at rest may be constant.
"""
CHECKS: dict[str, Callable[[CheckedBackend], str]] = {
    **{f"{fault} in motion": partial(ends, fault, moving=True) for fault in STOPPING},
    **{f"{fault} at rest": partial(ends, fault, moving=False) for fault in RESTING},
    "disconnect while stopping": partial(while_stopping, "disconnect"),
    "disconnect while recovering": partial(twice, "disconnect"),
    "disconnect while enabling": partial(while_enabling, "disconnect"),
    "disconnect while loading": partial(while_loading, "disconnect"),
    "disconnect in a stream": partial(in_stream, "disconnect"),
    "nan in a stream": partial(in_stream, "nan"),
    "loss": partial(survives, "loss"),
    "reorder": partial(survives, "reorder"),
    "pile_up": partial(survives, "pile_up"),
    "operation_mode": mode_change,
}
