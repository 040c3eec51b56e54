"""Sections of the settings that select a class: the robot's backend, and its gripper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer, ValidationError, ValidationInfo

from cobot.config.locations import resolve
from cobot.config.section import Model, Section
from cobot.errors import ConfigError
from cobot.strict import sentence, shown, unknown_key


class BackendSection(Section):
    """A class that drives a device. In YAML it is a name, or a mapping of `type` and the class's own options.

    Attributes:
        type: a name, or package.module:Class.
        options: options that the class itself defines.
        folder: folder for relative paths in the options; by default that of the settings file.
    """

    type: Annotated[str, Field(min_length=1, max_length=200)]
    options: dict[str, Any]
    folder: Path


def options_of(section: BackendSection, kind: type[Model], setting: str = "robot.backend") -> Model:
    """The options of a section, as an instance of the class's options model.

    Args:
        setting: setting name, for errors.

    Raises:
        ConfigError: a key is unknown (the error lists the valid ones) or a value is wrong.
    """
    for key in section.options:
        if key not in kind.model_fields:
            raise ConfigError(f"{setting}: {unknown_key(str(key), ['type', *kind.model_fields])}")
    try:
        return kind.model_validate(section.options, context={"folder": section.folder})
    except ValidationError as exc:
        raise ConfigError("; ".join(f"{setting}.{sentence(each)}" for each in exc.errors())) from exc


def _section(value: object, info: ValidationInfo, what: str) -> object:
    """Convert the content of a file to the fields of a `BackendSection`."""
    content = {"type": value} if isinstance(value, str) else value
    if not (isinstance(content, dict) and content.get("type")):
        raise ValueError(
            f"must be a name, or a mapping with a type and the {what}'s own options, got {shown(value)}"
        )
    nameless = [key for key in content if not isinstance(key, str)]
    if nameless:
        raise ValueError(
            f"the key {shown(nameless[0])} is not a string: the names of the {what}'s options must be strings"
        )
    options = {key: each for key, each in content.items() if key not in ("type", "folder")}
    folder = resolve(str(content.get("folder", ".")), (info.context or {})["folder"])
    return {"type": content["type"], "options": options, "folder": folder}


def _a_backend(value: object, info: ValidationInfo) -> object:
    return _section(value, info, "backend")


def _gripper_section(value: object, info: ValidationInfo) -> object:
    return None if value is None else _section(value, info, "gripper")


def _as_in_a_file(section: BackendSection | None) -> object:
    """The backend section with the absolute path of its folder, so that a file in any folder can contain
    it.
    """
    if section is None or not section.options:
        return section and section.type
    return {"type": section.type, "folder": str(section.folder), **section.options}


Backend = Annotated[BackendSection, BeforeValidator(_a_backend), PlainSerializer(_as_in_a_file)]
Gripper = Annotated[BackendSection | None, BeforeValidator(_gripper_section), PlainSerializer(_as_in_a_file)]
