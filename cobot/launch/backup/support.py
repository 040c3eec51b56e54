"""A support bundle: configuration without secrets, versions, health, logs, jobs and statistics."""

from __future__ import annotations

import json
import os
import platform
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import yaml

from cobot.config import Settings
from cobot.launch.backup.archive import pack

MAX_LOG_BYTES = 1_000_000
MAX_PART_BYTES = 3_000_000
"""Maximum size of each part that comes from the running service, in bytes. A larger part is replaced by a
note.
"""
REMOVED = "removed"
_SECRET = re.compile(r"token|secret|password|passphrase|credential|api_?key|private", re.IGNORECASE)
_IN_TEXT = re.compile(
    r"(?i)(bearer\s+|cobot\.token\.|(?:token|secret|password|passphrase)['\"]?\s*[:=]\s*['\"]?)[^\s'\",}]{4,}"
)


def make_bundle(settings: Settings, live: Mapping[str, bytes]) -> bytes:
    """Create the archive.

    Args:
        settings: settings of all robots.
        live: parts that only a running service can provide, by name; empty if no service is running.
    """
    files = {
        "settings.yaml": _yaml(settings),
        "computer.json": _json(_computer()),
        "packages.txt": "\n".join(
            sorted({f"{each.name} {each.version}" for each in distributions()})
        ).encode(),
    }
    for name, each in settings.each.items():
        files[f"{name}/log.txt"] = _end_of(each.log_file)
        for kind, path in (("tool", each.tool_file), ("scene", each.scene_file)):
            if path.is_file() and path.stat().st_size <= MAX_PART_BYTES:
                files[f"{name}/{kind}.json"] = path.read_bytes()
    for name, content in live.items():
        files[name] = (
            content if len(content) <= MAX_PART_BYTES else f"{len(content)} bytes, left out".encode()
        )
    clean = {name: without_secrets(content) for name, content in files.items()}
    about = {"made": datetime.now(UTC).isoformat(timespec="seconds"), "service_answered": bool(live)}
    return pack(clean, about)


def without_secrets(content: bytes) -> bytes:
    """Remove tokens and passwords from a text. Each value that looks like one is replaced."""
    text = content.decode("utf-8", "replace")
    return _IN_TEXT.sub(rf"\g<1>{REMOVED}", text).encode()


def _yaml(settings: Settings) -> bytes:
    content = _hidden(settings.model_dump(mode="json"))
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True).encode()


def _hidden(value: Any) -> Any:
    """A copy of the settings in which the value of each secret key is replaced."""
    if isinstance(value, dict):
        return {
            key: REMOVED if _SECRET.search(str(key)) and isinstance(each, str) else _hidden(each)
            for key, each in value.items()
        }
    return [_hidden(each) for each in value] if isinstance(value, list | tuple) else value


def _computer() -> dict[str, Any]:
    return {
        "system": platform.platform(),
        "python": platform.python_version(),
        "processors": os.cpu_count(),
        "load": os.getloadavg(),
        "memory": Path("/proc/meminfo").read_text(encoding="ascii").split("\n")[:12],
    }


def _end_of(path: Path) -> bytes:
    """The last lines of a file. The first line of the result is complete."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - MAX_LOG_BYTES))
            content = file.read(MAX_LOG_BYTES)
    except OSError as exc:
        return f"{path.name}: {exc.strerror}\n".encode()
    return content.partition(b"\n")[2] if size > MAX_LOG_BYTES else content


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=1, ensure_ascii=False).encode()
