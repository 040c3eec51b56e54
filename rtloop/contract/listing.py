"""The list of backends, with a description of each."""

from __future__ import annotations

import importlib.util
from dataclasses import asdict, dataclass
from typing import Any

from cobot.errors import ConfigError
from rtloop.backends import backend_class, backend_names, capabilities_of
from rtloop.backends.registry import REGISTRY


@dataclass(frozen=True, slots=True)
class Listed:
    """The readable description of a backend.

    Attributes:
        origin: the distribution that declares it.
        place: package.module:Class.
        periods_s: supported cycle periods; empty for any.
        capabilities: its capabilities in words; "" if its class cannot be loaded.
        contract: the subject of `cobot backend test`: "simulated device", "itself" or "nothing".
        problem: reason why it cannot be used here; "" if it can.
    """

    name: str
    origin: str
    place: str
    periods_s: tuple[float, ...] = ()
    capabilities: str = ""
    contract: str = "nothing"
    problem: str = ""

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def listed() -> list[Listed]:
    """All backends, by name."""
    origins = REGISTRY.origins()
    return [_one(name, origins[name], place) for name, place in sorted(backend_names().items())]


def _one(name: str, origin: str, place: str) -> Listed:
    try:
        kind: Any = backend_class(name)
        found = capabilities_of(kind)
    except ConfigError as exc:
        return Listed(name, origin, place, problem=str(exc).removeprefix("robot.backend: "))
    hook = hasattr(kind, "contract_rig")
    return Listed(
        name,
        origin,
        place,
        found.periods_s,
        found.words,
        "simulated device" if hook else "nothing" if found.hardware else "itself",
        _missing(kind),
    )


def _missing(kind: Any) -> str:
    """The missing SDK of a backend, which the backend imports only when it is made. A class names it in the
    attribute `sdk`.
    """
    sdk = getattr(kind, "sdk", "")
    if not sdk or importlib.util.find_spec(sdk) is not None:
        return ""
    return f"needs {sdk}, which is not installed"
