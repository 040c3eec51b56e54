"""All checks of a backend, with their results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from cobot.config import Settings
from cobot.errors import CobotError
from cobot.foreign import plain_error, plain_text
from cobot.robot.description import load_robot
from rtloop.backends import BackendError, backend_class, capabilities_of
from rtloop.contract import checks, declared, faults, inputs_outputs, punctuality
from rtloop.contract.cell import Cell, NotTested
from rtloop.contract.driver import ContractError
from rtloop.contract.rig import rig_of

CHECKS = {
    **declared.CHECKS,
    **checks.CHECKS,
    **punctuality.CHECKS,
    **inputs_outputs.CHECKS,
    **faults.CHECKS,
}


class Verdict(StrEnum):
    PASSED = "passed"
    FAILED = "FAILED"
    NOT_TESTED = "not tested"


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a check: what was found, what is wrong, or what is missing."""

    check: str
    verdict: Verdict
    found: str


def settings_for(settings: Settings, name: str) -> Settings:
    """Settings for a robot with this backend: its options, if given for it, and a supported period."""
    robot, rt = settings.robot, settings.rt
    if robot.backend.type != name:
        backend = robot.backend.model_copy(update={"type": name, "options": {}})
        robot = robot.model_copy(update={"backend": backend})
    periods = capabilities_of(backend_class(name)).periods_s
    if periods and capabilities_of(backend_class(name)).period_refusal(rt.period_s):
        rt = rt.model_copy(update={"period_s": min(periods)})
    return settings.model_copy(update={"robot": robot, "rt": rt})


def cell_for(settings: Settings, name: str, *, realtime: bool = False) -> Cell:
    """Prepare a backend for the checks.

    Raises:
        ConfigError: the backend does not exist, would move a real arm, or the settings are invalid.
    """
    settings = settings_for(settings, name)
    kind: Any = backend_class(name)
    cell = Cell(kind, settings, load_robot(settings), realtime)
    rig_of(kind, settings, cell.robot.limits)
    return cell


def examined(cell: Cell, check: str) -> Result:
    """Run one check. A backend that raises an unexpected exception has failed it."""
    try:
        with np.errstate(all="ignore"):  # as in rtloop: comparisons find values that are not finite
            return Result(check, Verdict.PASSED, CHECKS[check](cell))
    except NotTested as exc:
        return Result(check, Verdict.NOT_TESTED, str(exc))
    except (ContractError, BackendError, CobotError) as exc:
        return Result(check, Verdict.FAILED, plain_text(exc))
    except KeyboardInterrupt:
        raise
    except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
        return Result(check, Verdict.FAILED, plain_error(exc))


def run(cell: Cell) -> Iterator[Result]:
    """Run all checks, one after the other."""
    for check in CHECKS:
        yield examined(cell, check)
