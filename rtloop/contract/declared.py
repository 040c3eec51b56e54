"""Checks of the capabilities and options that a backend's class declares."""

from __future__ import annotations

from collections.abc import Callable

from cobot.config import Settings
from cobot.contract_checks import ContractError
from cobot.errors import ConfigError
from rtloop.backends import Reporting, capabilities_of, make_backend
from rtloop.contract.cell import CheckedBackend

CLAIMS = {
    "impedance": ("set_impedance",),
    "torque": ("write_torque", "set_impedance"),
    "wrench": ("write_wrench",),
    "freedrive": ("set_impedance", "begin_guiding"),
    "payload": ("set_tool",),
    "io": ("set_output",),
}
"""For each capability, a list of methods of which the class must implement at least one."""


def options(cell: CheckedBackend) -> str:
    """An unknown option and an unsupported period are rejected with errors that name them."""
    with cell.make_driver() as driver:
        settings: Settings = getattr(driver.rig, "settings", cell.settings)
    backend = settings.robot.backend
    key = "no_such_option"
    unknown = backend.model_copy(update={"options": {**backend.options, key: 1}})
    robot = settings.robot.model_copy(update={"backend": unknown})
    _require_refusal(cell, settings.model_copy(update={"robot": robot}), key)
    periods = capabilities_of(cell.kind).periods_s
    if not periods:
        return "an unknown option is rejected; any period is supported"
    rt = settings.rt.model_copy(update={"period_s": 7.7 * max(periods)})
    _require_refusal(cell, settings.model_copy(update={"rt": rt}), "rt.period_s")
    return "an unknown option and another period are rejected"


def _require_refusal(cell: CheckedBackend, settings: Settings, word: str) -> None:
    try:
        make_backend(settings, cell.robot.limits)
    except ConfigError as exc:
        if word in str(exc):
            return
        raise ContractError(f"the error does not mention {word}: {exc}") from exc
    raise ContractError(f"an invalid {word} is not rejected")


def claims(cell: CheckedBackend) -> str:
    """The class implements the methods that its `capabilities` require."""
    with cell.make_driver() as driver:
        backend = driver.rig.backend()
    able = capabilities_of(backend)
    for flags, methods in CLAIMS.items():
        if getattr(able, flags) and not any(hasattr(backend, method) for method in methods):
            raise ContractError(
                f"capabilities.{flags} requires a method {' or '.join(methods)}, which is missing"
            )
    if able.hardware and not isinstance(backend, Reporting):
        raise ContractError("capabilities.hardware requires a method status, which is missing")
    return able.words


CHECKS: dict[str, Callable[[CheckedBackend], str]] = {"options": options, "claims": claims}
