"""Checks of a contract and their results, for backends (`rtloop.contract`) and grippers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from cobot.errors import CobotError
from cobot.foreign import plain_error, plain_text


class ContractError(Exception):
    """A class violates its contract. The text says how."""


class NotTested(Exception):
    """The device or its rig lacks something that a check needs. The text says what is missing."""


class CheckVerdict(StrEnum):
    PASSED = "passed"
    FAILED = "FAILED"
    NOT_TESTED = "not tested"


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of a check, with a text: the finding, the error, or the missing feature."""

    check: str
    verdict: CheckVerdict
    found: str


def result_of(check: str, run: Callable[[], str], problem: type[Exception]) -> CheckResult:
    """Run one check. It has failed if the class raises an unexpected exception.

    Args:
        run: executes the check and returns the finding.
        problem: an exception, in addition to those of cobot, whose text is for people.
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
