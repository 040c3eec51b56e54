"""The extra that fleets need."""

from __future__ import annotations

from importlib.util import find_spec

from cobot.errors import ConfigError


def require_zenoh(setting: str) -> None:
    """
    Raises:
        ConfigError: the extra with Zenoh is not installed.
    """
    if find_spec("zenoh") is None:
        raise ConfigError(
            f"{setting}: a fleet needs Zenoh, which is not installed: pip install 'cobot[fleet]'"
        )
