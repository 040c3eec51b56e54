"""The common base of all sections of the settings: strict checks and their error messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from cobot.errors import ConfigError
from cobot.strict import StrictModel, sentence

Model = TypeVar("Model", bound=BaseModel)


class Section(StrictModel):
    """Base of all sections. Pydantic compiles them once together with the whole settings, and not each one
    separately.
    """

    model_config = ConfigDict(frozen=True, defer_build=True)


def parse(kind: type[Model], path: Path, content: dict[str, Any], place: str = "") -> Model:
    """Validate the content of a file as a model.

    Args:
        path: file path. Relative paths in the content are resolved against its folder.
        place: location of the content in the file, for errors.

    Raises:
        ConfigError: the content is invalid; the message names the file, the key, the value and the valid
            values.
    """
    try:
        return kind.model_validate(content, context={"folder": path.parent})
    except ValidationError as exc:
        raise ConfigError(f"{path}: {place}" + "; ".join(map(sentence, exc.errors()))) from exc


@contextmanager
def naming(setting: str) -> Iterator[None]:
    """Context manager that prefixes errors with the name of the setting that people can change."""
    try:
        yield
    except ConfigError as exc:
        raise ConfigError(f"{setting}: {exc}") from exc
