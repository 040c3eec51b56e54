"""Strict reading of YAML files."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor

from cobot.errors import ConfigError


def read_yaml(path: Path) -> Any:
    """Read a YAML file. A key that occurs twice in a mapping is an error.

    Raises:
        ConfigError: the file is missing, unreadable or malformed.
    """
    try:
        return _load(path.read_text(encoding="utf-8"))
    except FileNotFoundError as exc:
        raise ConfigError(f"{path}: no such file") from exc
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigError(f"{path}: cannot be read: {exc}") from exc
    except (yaml.YAMLError, RecursionError, ValueError, TypeError) as exc:  # an invalid date, a list as a key
        raise ConfigError(f"{path}: not valid YAML: {' '.join(str(exc).split())}") from exc


def _load(source: str) -> Any:
    if yaml.__with_libyaml__:
        with contextlib.suppress(yaml.YAMLError):  # the Python loader reports it in clearer words
            return yaml.load(source, _FastLoader)
    return yaml.load(source, _Loader)


class _UniqueKeys(SafeConstructor):
    """Rejects duplicate keys. YAML would silently use the last one, and a robot's limits must not depend on
    this.
    """

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = str(key_node.value)
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{key!r} occurs twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


class _Loader(_UniqueKeys, yaml.SafeLoader):
    """Loads YAML in pure Python."""


if yaml.__with_libyaml__:

    class _FastLoader(Composer, _UniqueKeys, yaml.CSafeLoader):
        """Parses YAML in C, five times as fast as in Python, because each cobot process reads three files
        when it starts.

        Nested nodes are composed in Python. libyaml's composer is recursive in C, so a file with 100,000
        brackets would crash the process.
        """

        def __init__(self, stream: str) -> None:
            yaml.CSafeLoader.__init__(self, stream)
            Composer.__init__(self)


def read_mapping(path: Path) -> dict[str, Any]:
    """Read a YAML file that contains a mapping.

    Raises:
        ConfigError: see `read_yaml`. Also if the file does not contain a mapping.
    """
    content = read_yaml(path)
    if not isinstance(content, dict):
        found = "nothing" if content is None else type(content).__name__
        raise ConfigError(f"{path}: must contain a mapping, got {found}")
    return content
