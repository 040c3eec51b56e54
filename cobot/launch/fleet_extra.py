"""The optional package that fleets need."""

from __future__ import annotations

from importlib.util import find_spec

from cobot.errors import ConfigError


def require_zenoh(setting: str) -> None:
    """Check that the optional package with Zenoh is installed.

    Raises:
        ConfigError: it is not installed.
    """
    if find_spec("zenoh") is None:
        raise ConfigError(
            f"{setting}: a fleet needs Zenoh, which is not installed: pip install 'cobot[fleet]'"
        )
