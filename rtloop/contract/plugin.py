"""The backend contract as pytest tests, loaded with `-p rtloop.contract.plugin`.

A test with the fixture `contract_check` and the name of a backend is run once for each check:

    @pytest.mark.cobot_backend("gantry")
    def test_contract(contract_check):
        contract_check()

Checks that cannot be run for this backend are skipped, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from cobot.config import load_settings
from cobot.contract_checks import CheckVerdict
from rtloop.contract.cell import CheckedBackend
from rtloop.contract.suite import CHECKS, cell_for, examine

MARKER = "cobot_backend"


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", f"{MARKER}(name): the backend that contract_check is about")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "contract_check" in metafunc.fixturenames:
        metafunc.parametrize("contract_check", list(CHECKS), indirect=True)


@pytest.fixture
def contract_check(request: pytest.FixtureRequest) -> Callable[[], None]:
    """Return a function that runs one check of the backend named in the test's marker."""
    marker = request.node.get_closest_marker(MARKER)
    if marker is None or len(marker.args) != 1:
        raise pytest.UsageError(f'{request.node.name} needs @pytest.mark.{MARKER}("NAME")')

    def check() -> None:
        result = examine(_cell(marker.args[0]), request.param)
        if result.verdict is CheckVerdict.NOT_TESTED:
            pytest.skip(result.found)
        if result.verdict is CheckVerdict.FAILED:
            pytest.fail(f"{result.check}: {result.found}", pytrace=False)

    return check


@cache
def _cell(name: str) -> CheckedBackend:
    return cell_for(load_settings(), name)
