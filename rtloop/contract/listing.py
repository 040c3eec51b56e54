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
        place: location of its class, as package.module:Class.
        periods_s: supported cycle periods; empty for any.
        capabilities: its capabilities in words; "" if its class cannot be loaded.
        contract: what `cobot backend test` runs on: a "simulated device", the backend "itself", or "nothing".
        problem: reason why the backend cannot be used on this computer; "" if it can be used.
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
    """List all backends, sorted by name."""
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
    """Return the SDK that a backend needs but that is not installed; "" if none is missing. A class names its
    SDK in the attribute `sdk`, because it imports the SDK only when an instance is made.
    """
    sdk = getattr(kind, "sdk", "")
    if not sdk or importlib.util.find_spec(sdk) is not None:
        return ""
    return f"needs {sdk}, which is not installed"
