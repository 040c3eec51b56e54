"""Finds the classes that settings name: cobot's own, and those that installed packages declare."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

from cobot.errors import ConfigError
from cobot.foreign import plain_error


@dataclass(frozen=True, slots=True)
class Registry:
    """Classes that settings can name.

    Attributes:
        group: group of the entry points.
        setting: the setting that names a class, for errors.
        shipped: locations of cobot's classes, package.module:Class, by name. These are also entry points of
            cobot. They are listed here so that they are found in a source tree that is not installed.
    """

    group: str
    setting: str
    shipped: Mapping[str, str]

    def names(self) -> dict[str, str]:
        """All names, each with the location of its class."""
        found = {each.name: each.value for each in entry_points(group=self.group)}
        return {**found, **self.shipped}

    def origins(self) -> dict[str, str]:
        """All names, each with the distribution that declares it."""
        found = {
            each.name: f"{each.dist.name} {each.dist.version}"
            for each in entry_points(group=self.group)
            if each.dist
        }
        return {
            name: "cobot" if name in self.shipped else found.get(name, "unknown") for name in self.names()
        }

    def load(self, name: str) -> Callable[..., Any]:
        """The class for a name or for "package.module:Class".

        Raises:
            ConfigError: the class does not exist or cannot be loaded. The error lists the valid names.
        """
        names = self.names()
        module, _, attribute = names.get(name, name).partition(":")
        if not attribute:
            raise ConfigError(
                f"{self.setting}: there is no {name!r}; valid names: {', '.join(sorted(names))}, or "
                "package.module:Class"
            )
        try:
            kind: Any = importlib.import_module(module)
            for part in attribute.split("."):
                kind = getattr(kind, part)
        except KeyboardInterrupt:
            raise
        except BaseException as exc:  # a module from another package may raise anything
            raise self.unloadable(name, exc) from exc
        if not callable(kind):
            raise ConfigError(f"{self.setting}: cannot load {name!r}: {attribute} is not a class")
        made: Callable[..., Any] = kind
        return made

    def unloadable(self, name: str, exc: BaseException) -> ConfigError:
        """The error for a class that raises `exc` when it is loaded or called."""
        return ConfigError(f"{self.setting}: cannot load {name!r}: {plain_error(exc)}")
