"""YAML files, read strictly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from cobot.errors import ConfigError


def read_yaml(path: Path) -> Any:
    """A YAML file's content; a key that stands twice in a mapping is an error.

    Raises:
        ConfigError: missing, unreadable or malformed.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _UniqueKeyLoader)
    except FileNotFoundError as exc:
        raise ConfigError(f"{path}: no such file") from exc
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigError(f"{path}: cannot be read: {exc}") from exc
    except (yaml.YAMLError, RecursionError, ValueError, TypeError) as exc:  # no such date, a list as a key
        raise ConfigError(f"{path}: not valid YAML: {' '.join(str(exc).split())}") from exc


class _UniqueKeyLoader(yaml.SafeLoader):
    """YAML lets a second key win silently; a robot's limits must not depend on that."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = str(key_node.value)
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{key!r} stands twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


def read_mapping(path: Path) -> dict[str, Any]:
    """The same, of a file that holds a mapping.

    Raises:
        ConfigError: as above, or it holds something else.
    """
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: must hold a mapping, got {type(content).__name__}")
    return content
