"""The backend that moves the robot, as the settings name it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer, ValidationError, ValidationInfo

from cobot.config.locations import resolve
from cobot.config.section import Model, Section
from cobot.errors import ConfigError
from cobot.strict import sentence, shown, unknown_key


class BackendSection(Section):
    """The backend of a robot. In YAML it is a name, or a mapping of `type` and the backend's own options.

    Attributes:
        type: a name, or package.module:Class.
        options: options that the backend itself defines.
        folder: folder for relative paths in the options; by default that of the settings file.
    """

    type: Annotated[str, Field(min_length=1, max_length=200)]
    options: dict[str, Any]
    folder: Path


def options_of(backend: BackendSection, kind: type[Model]) -> Model:
    """The backend's options, as an instance of its own model.

    Raises:
        ConfigError: a key is unknown (the error lists the valid ones) or a value is wrong.
    """
    for key in backend.options:
        if key not in kind.model_fields:
            raise ConfigError(f"robot.backend: {unknown_key(str(key), ['type', *kind.model_fields])}")
    try:
        return kind.model_validate(backend.options, context={"folder": backend.folder})
    except ValidationError as exc:
        raise ConfigError("; ".join(f"robot.backend.{sentence(each)}" for each in exc.errors())) from exc


def _a_backend(value: object, info: ValidationInfo) -> object:
    """The content of a file, as the fields of a `BackendSection`."""
    content = {"type": value} if isinstance(value, str) else value
    if not (isinstance(content, dict) and content.get("type")):
        raise ValueError(
            f"must be a name, or a mapping with a type and the backend's own options, got {shown(value)}"
        )
    nameless = [key for key in content if not isinstance(key, str)]
    if nameless:
        raise ValueError(f"the key {shown(nameless[0])} is no text: an option of the backend has a name")
    options = {key: each for key, each in content.items() if key not in ("type", "folder")}
    folder = resolve(str(content.get("folder", ".")), (info.context or {})["folder"])
    return {"type": content["type"], "options": options, "folder": folder}


def _as_in_a_file(backend: BackendSection) -> object:
    """The complete section, with its folder, so that a file elsewhere can contain it."""
    if not backend.options:
        return backend.type
    return {"type": backend.type, "folder": str(backend.folder), **backend.options}


Backend = Annotated[BackendSection, BeforeValidator(_a_backend), PlainSerializer(_as_in_a_file)]
