"""A bundle: the programs, named positions and settings that a fleet rolls out together, as JSON.

The name of a bundle is the SHA-256 of its content.
"""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from cobot.errors import InputError
from cobot.fleet.cell_settings import BundleFile, files_of
from cobot.fleet.messages import Name, Program, Text
from cobot.strict import StrictModel, sentences

MAX_BUNDLE_BYTES = 8 * 2**20
Position = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]


class BundleProgram(StrictModel):
    """A stored program: a sequence file or a Lua program as text."""

    id: Program
    label: Annotated[str, Field(min_length=1, max_length=64)]
    kind: Literal["sequence", "lua"]
    text: Annotated[str, Field(max_length=400_000)]


class BundlePosition(StrictModel):
    """A named position: joint angles, rad (m for a linear joint)."""

    name: Position
    joints: Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=1, max_length=64)]
    label: Text = ""
    description: Text = ""


class Bundle(StrictModel):
    """The bundle content."""

    name: Name
    version: Annotated[str, Field(pattern=r"^[A-Za-z0-9._+-]{1,48}$")]
    programs: Annotated[list[BundleProgram], Field(default_factory=list, max_length=100)]
    positions: Annotated[list[BundlePosition], Field(default_factory=list, max_length=1000)]
    settings: Annotated[list[BundleFile], Field(default_factory=list, max_length=100)]

    @property
    def title(self) -> str:
        return f"{self.name} {self.version}"


def read_bundle(content: bytes) -> Bundle:
    """Read the bundle content.

    Raises:
        InputError: the content is not a bundle.
    """
    if len(content) > MAX_BUNDLE_BYTES:
        raise InputError(f"the bundle has {len(content)} bytes, allowed: {MAX_BUNDLE_BYTES}")
    try:
        bundle = Bundle.model_validate_json(content)
    except ValidationError as exc:
        raise InputError(f"the bundle is not valid: {sentences(exc.errors())}") from exc
    for what, names in (
        ("program", [each.id for each in bundle.programs]),
        ("position", [each.name for each in bundle.positions]),
        ("file", [each.path for each in bundle.settings]),
    ):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"the bundle has the {what} {twice[0]!r} twice")
    paths = {each.path for each in bundle.settings}
    for path in sorted(paths):
        above = next((str(each) for each in PurePosixPath(path).parents if str(each) in paths), None)
        if above is not None:
            raise InputError(
                f"the bundle has a file {above!r}, which is also the folder of the file {path!r}; "
                "rename one of them"
            )
    return bundle


def hash_of(content: bytes) -> str:
    """The name of the bundle with this content."""
    return sha256(content).hexdigest()


def bundle_of(folder: Path, name: str, version: str) -> bytes:
    """Make the content of a bundle from the folders `programs` and `settings`, and the file `positions.json`.

    Args:
        folder: contains them. `programs` contains sequence files and Lua programs. `settings` contains
            `settings.yaml` and the files that it names. `positions.json` is an object with the joint angles
            for each name.

    Raises:
        InputError: the folder contains none of them, or they cannot be read.
    """
    try:
        files = sorted(each for each in (folder / "programs").glob("*") if each.suffix in (".json", ".lua"))
        programs = [
            {
                "id": file.stem,
                "label": file.stem,
                "kind": "lua" if file.suffix == ".lua" else "sequence",
                "text": file.read_text(encoding="utf-8"),
            }
            for file in files
        ]
        found = folder / "positions.json"
        named = json.loads(found.read_text(encoding="utf-8")) if found.exists() else {}
        settings = files_of(folder / "settings")
    except (OSError, ValueError) as exc:
        raise InputError(f"{folder}: cannot be read: {exc}") from exc
    if not isinstance(named, dict):
        raise InputError(f"{found}: must be an object with the joint angles of each name")
    if not programs and not named and not settings:
        raise InputError(
            f"{folder}: contains no programs/*.json, programs/*.lua, positions.json or "
            "settings/settings.yaml; add at least one"
        )
    positions = [{"name": each, "joints": joints} for each, joints in named.items()]
    parts = {"programs": programs, "positions": positions, "settings": settings}
    content = json.dumps({"name": name, "version": version, **parts})
    read_bundle(content.encode())
    return content.encode()
