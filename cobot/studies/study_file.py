"""Reads the YAML file of a study."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, cast

from cobot.config.section import parse
from cobot.errors import ConfigError
from cobot.strict import unknown_key
from cobot.studies.programs.sequence_program import with_programs
from cobot.studies.study import Study
from cobot.yaml_file import read_mapping

KINDS: Mapping[str, str] = {
    "reach": "kinds.reach:ReachStudy",
    "placement": "kinds.placement:PlacementStudy",
    "python": "kinds.function_study:FunctionStudy",
    "cycle": "kinds.cycle:CycleStudy",
    "robustness": "kinds.robustness:RobustnessStudy",
    "compare": "kinds.compare:CompareStudy",
}
"""Module and class of each kind. Only the module of the kind that is used is imported."""


def load_study(path: Path | str) -> Study:
    """Read a study.

    Raises:
        ConfigError: the file is missing or invalid; the message names the file, the key, the value and the
            valid values.
    """
    path = Path(path)
    return study_of(read_mapping(path), path.resolve().parent, str(path))


def study_of(document: dict[str, Any], folder: Path | str = ".", name: str = "study") -> Study:
    """Create a study from a file's content.

    Args:
        folder: folder for relative paths.
        name: name of the document, for errors.

    Raises:
        ConfigError: see `load_study`.
    """
    kind = document.get("kind")
    if "kind" not in document:
        raise ConfigError(f"{name}: kind: is missing; valid kinds: {', '.join(KINDS)}")
    if not isinstance(kind, str) or kind not in KINDS:
        raise ConfigError(f"{name}: kind: {unknown_key(str(kind), list(KINDS), 'kind')}")
    module, class_name = KINDS[kind].split(":")
    cls = cast(type[Study], getattr(import_module(f"cobot.studies.{module}"), class_name))
    folder = Path(folder).resolve()
    document = with_programs(document, folder, name)
    study = parse(cls, folder / Path(name).name, document)
    study.keep_source(document, folder)
    return study
