"""Contract checks and their results, for backends (`rtloop.contract`) and grippers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from cobot.errors import CobotError
from cobot.foreign import plain_error, plain_text


class ContractError(Exception):
    """Raised when a class violates its contract. The text describes the violation."""


class NotTested(Exception):
    """Raised by a check that needs something that the device or its rig does not provide. The text names what
    is missing.
    """


class CheckVerdict(StrEnum):
    PASSED = "passed"
    FAILED = "FAILED"
    NOT_TESTED = "not tested"


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of a check. Its text is the finding, the error, or the missing feature."""

    check: str
    verdict: CheckVerdict
    found: str


def result_of(check: str, run: Callable[[], str], problem: type[Exception]) -> CheckResult:
    """Run one check. The check fails if the class raises an unexpected exception.

    Args:
        run: executes the check and returns the finding.
        problem: exception class, in addition to cobot's own, whose message can be shown to users.
    """
    try:
        return CheckResult(check, CheckVerdict.PASSED, run())
    except NotTested as exc:
        return CheckResult(check, CheckVerdict.NOT_TESTED, str(exc))
    except (ContractError, CobotError, problem) as exc:
        return CheckResult(check, CheckVerdict.FAILED, plain_text(exc))
    except KeyboardInterrupt:
        raise
    except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
        return CheckResult(check, CheckVerdict.FAILED, plain_error(exc))
