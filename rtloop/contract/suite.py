"""Runs all checks of a backend and collects their results."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cobot.config import Settings
from cobot.contract_checks import CheckResult, result_of
from cobot.robot.description import load_robot
from rtloop.backends import BackendError, backend_class, capabilities_of
from rtloop.contract import checks, declared, faults, inputs_outputs, punctuality
from rtloop.contract.cell import CheckedBackend
from rtloop.contract.rig import rig_of

CHECKS = {
    **declared.CHECKS,
    **checks.CHECKS,
    **punctuality.CHECKS,
    **inputs_outputs.CHECKS,
    **faults.CHECKS,
}


def settings_for(settings: Settings, name: str) -> Settings:
    """Return settings for a robot with this backend and a supported period. The options are kept if they
    belong to this backend.
    """
    robot, rt = settings.robot, settings.rt
    if robot.backend.type != name:
        backend = robot.backend.model_copy(update={"type": name, "options": {}})
        robot = robot.model_copy(update={"backend": backend})
    periods = capabilities_of(backend_class(name)).periods_s
    if periods and capabilities_of(backend_class(name)).period_refusal(rt.period_s):
        rt = rt.model_copy(update={"period_s": min(periods)})
    return settings.model_copy(update={"robot": robot, "rt": rt})


def cell_for(settings: Settings, name: str, *, realtime: bool = False) -> CheckedBackend:
    """Prepare a backend for the checks.

    Raises:
        ConfigError: the backend does not exist or would move a real arm, or the settings are invalid.
    """
    settings = settings_for(settings, name)
    kind: Any = backend_class(name)
    cell = CheckedBackend(kind, settings, load_robot(settings), realtime)
    rig_of(kind, settings, cell.robot.limits)
    return cell


def examine(cell: CheckedBackend, check: str) -> CheckResult:
    """Run one check. The check fails if the backend raises an unexpected exception."""
    with np.errstate(all="ignore"):  # as in rtloop, which finds non-finite values by comparisons
        return result_of(check, lambda: CHECKS[check](cell), BackendError)


def run(cell: CheckedBackend) -> Iterator[CheckResult]:
    """Run all checks, one at a time."""
    for check in CHECKS:
        yield examine(cell, check)
