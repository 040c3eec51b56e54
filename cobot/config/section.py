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
    """Base of all sections. Pydantic builds them with the settings as a whole, not also each by itself."""

    model_config = ConfigDict(frozen=True, defer_build=True)


def parse(kind: type[Model], path: Path, content: dict[str, Any], place: str = "") -> Model:
    """What a file says, as a model of it.

    Args:
        path: of the file, against whose folder paths in it are resolved.
        place: of the content in it, for errors.

    Raises:
        ConfigError: naming the file, the key, the value and what is valid.
    """
    try:
        return kind.model_validate(content, context={"folder": path.parent})
    except ValidationError as exc:
        raise ConfigError(f"{path}: {place}" + "; ".join(map(sentence, exc.errors()))) from exc


@contextmanager
def naming(setting: str) -> Iterator[None]:
    """Have errors of what a setting names begin with the setting, which is what people can change."""
    try:
        yield
    except ConfigError as exc:
        raise ConfigError(f"{setting}: {exc}") from exc
