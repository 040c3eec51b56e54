"""A check of a contract, and its result: for backends (`rtloop.contract`) and grippers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from cobot.errors import CobotError
from cobot.foreign import plain_error, plain_text


class ContractError(Exception):
    """A class violates its contract; the text says where."""


class NotTested(Exception):
    """The device or its rig lacks something that a check needs; the text says what."""


class CheckVerdict(StrEnum):
    PASSED = "passed"
    FAILED = "FAILED"
    NOT_TESTED = "not tested"


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of a check: what was found, what is wrong, or what is missing."""

    check: str
    verdict: CheckVerdict
    found: str


def result_of(check: str, run: Callable[[], str], problem: type[Exception]) -> CheckResult:
    """Run one check. A class that raises an unexpected exception has failed it.

    Args:
        run: returns what was found.
        problem: an exception whose text is meant for people, in addition to those of cobot.
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
