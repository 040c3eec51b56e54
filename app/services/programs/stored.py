"""Stored programs in a folder of the robot. Their names can be in any language. Several versions of each are
kept.

Each version is a separate file, which `keep` writes completely or not at all, so a full disk or a killed
process leaves earlier versions unchanged. The files are read for each request; there is no copy in memory
that could differ from them.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from app.services.clients import CLIENT
from app.services.state.link import RobotLink
from cobot.cell import ExampleProgram
from cobot.clock import utc_now
from cobot.errors import ChangedError, ConflictError, InputError, NotFoundError, UnavailableError
from cobot.robot.kept import keep, read_kept
from cobot.strict import shown

MAX_PROGRAMS, MAX_VERSIONS = 200, 20
"""Maximum number of programs, and maximum number of versions of each program. If there are more versions, the
oldest ones are deleted.
"""
MAX_CHARACTERS = 400_000
"""Maximum length of a program's text, in characters."""
MAX_TOTAL_BYTES = 200_000_000
"""Maximum size of the folder, in bytes."""
MAX_DELETED = 1000
"""Maximum number of deleted programs whose last version number is kept individually."""
DELETED = ".deleted.json"
"""Name of the file with the last version number of each deleted program. A new program with the same id
continues the numbering, so a client that still has the deleted program open cannot overwrite the new one.
"""
ID_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,63}$"
SUFFIXES = {"sequence": ".json", "lua": ".lua"}
"""Suffix of the file for each kind of program."""
_ID = re.compile(ID_PATTERN)
_VERSION = re.compile(r"([0-9]{1,9})\.json")
Result = TypeVar("Result")
log = logging.getLogger("cobot.programs")


@dataclass(frozen=True, slots=True)
class ProgramText:
    """The content of a stored program.

    Attributes:
        label: displayed name, in any language.
        kind: "sequence" or "lua".
        text: the unchanged JSON document or Lua program.
        note: description of this version.
    """

    label: str
    kind: str
    text: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class ProgramVersion:
    """One version of a stored program.

    Attributes:
        author: name of the client that saved the version: the name of its token or, without one, its own name
            in quotes.
        time: time of saving, ISO 8601 in UTC. For an example, the time at which the service started.
        example: whether the program belongs to the robot's cell. An example can be copied, but neither
            changed nor deleted.
    """

    id: str
    version: int
    author: str
    time: str
    saved: ProgramText
    example: bool = False

    @property
    def file_name(self) -> str:
        """File name, for the runner and for export."""
        return f"{self.id}{SUFFIXES[self.saved.kind]}"


@dataclass(frozen=True, slots=True)
class Deleted:
    """The last version numbers of deleted programs.

    Attributes:
        last: the last version number by the program's id, with the newest deletion at the end.
        others: the highest version number of all programs that were dropped from `last`.
    """

    last: dict[str, int]
    others: int = 0

    def version_of(self, program: str) -> int:
        """Return the number of the last deleted version with this program id. A new program with the id
        continues after this number.
        """
        return self.last.get(program, self.others)

    def with_program(self, program: str, version: int) -> Deleted:
        """Return a copy with a deleted program added."""
        last = {each: number for each, number in self.last.items() if each != program} | {program: version}
        gone = list(last)[: max(len(last) - MAX_DELETED, 0)]
        others = max([self.others, *(last.pop(each) for each in gone)])
        return Deleted(last, others)


_FILE = TypeAdapter(ProgramVersion)
_DELETED = TypeAdapter(Deleted)


class StoredPrograms:
    """The stored programs of one robot.

    Args:
        folder: folder of the programs. It is created with the first program, and only the user can read it.
        examples: example programs of the robot's cell, which are included in lists.
    """

    def __init__(self, folder: Path, link: RobotLink, examples: Sequence[ExampleProgram] = ()) -> None:
        self._folder = folder
        self._link = link
        started = utc_now(link.clock).isoformat(timespec="seconds")
        versions = [_example(each, started) for each in examples]
        self._examples = {each.id: each for each in versions}
        self._turn = asyncio.Lock()

    async def all(self) -> list[ProgramVersion]:
        """List the newest version of each program, sorted by label."""
        return await asyncio.to_thread(self._all)

    async def read(self, program: str, version: int | None = None) -> ProgramVersion:
        """Read one version; by default the newest.

        Raises:
            NotFoundError: there is no such program or version.
            UnavailableError: the file cannot be read.
        """
        return await asyncio.to_thread(self._read, program, version)

    async def versions(self, program: str) -> list[ProgramVersion]:
        """List all kept versions of a program, newest first.

        Raises:
            NotFoundError: there is no such program.
            UnavailableError: a file cannot be read.
        """
        if program in self._examples:
            return [self._examples[program]]
        numbers = await asyncio.to_thread(self._require, program)
        return await asyncio.to_thread(lambda: [self._read(program, each) for each in reversed(numbers)])

    async def save(self, program: str, saved: ProgramText, base: int | None) -> ProgramVersion:
        """Save a version. Returns once it has been written to disk. If the same text is saved again, for
        example after a lost answer, no new version is made.

        Args:
            base: number of the version that was edited; None for a new program.

        Raises:
            ChangedError: a newer version has been saved in the meantime, or the program already exists or has
                been deleted.
            InputError: the id is invalid, or the text is not a JSON object.
            ConflictError: there are too many programs, their folder is too large, or the program is an
                example.
            UnavailableError: the file cannot be written; the former version is unchanged.
        """
        if not _ID.fullmatch(program):
            raise InputError(
                f"program: {shown(program)} is not a valid id; use at most 64 characters of a-z, 0-9, _ and -"
            )
        self._require_no_example(program)
        if saved.kind == "sequence":
            _require_object(saved.text)
        author = CLIENT.get().name
        made = await self._one_at_a_time(lambda: self._save(program, saved, base, author))
        self._tell("saved", made)
        return made

    async def delete(self, program: str, base: int | None) -> None:
        """Delete a program with all its versions.

        Args:
            base: number of the newest version that the client knows; None to delete the program regardless of
                its version.

        Raises:
            NotFoundError: there is no such program.
            ChangedError: another version has been saved in the meantime.
            ConflictError: the program is an example.
            UnavailableError: the disk does not permit it.
        """
        self._require_no_example(program)
        self._tell("deleted", await self._one_at_a_time(lambda: self._delete(program, base)))

    def _require_no_example(self, program: str) -> None:
        if program in self._examples:
            raise ConflictError(
                f"program {shown(program)} is an example of the cell and cannot be changed; save your "
                "program under another id"
            )

    async def _one_at_a_time(self, work: Callable[[], Result]) -> Result:
        async with self._turn:
            return await asyncio.to_thread(work)

    def _tell(self, what: str, of: ProgramVersion) -> None:
        self._link.events.publish(
            "program", what=what, id=of.id, label=of.saved.label, version=of.version, by=str(CLIENT.get())
        )

    def _all(self) -> list[ProgramVersion]:
        found = list(self._examples.values())
        for program in self._ids():
            if program in self._examples:
                continue
            try:
                found.append(self._read(program, None))
            except (NotFoundError, UnavailableError) as exc:  # deleted in the meantime, or damaged
                log.warning("%s", exc)
        return sorted(found, key=lambda each: (each.saved.label.casefold(), each.id))

    def _ids(self) -> list[str]:
        if not self._folder.is_dir():
            return []
        return [each.name for each in self._folder.iterdir() if _ID.fullmatch(each.name)]

    def _numbers(self, program: str) -> list[int]:
        """List the numbers of the kept versions, in ascending order."""
        return _numbers_in(self._folder / program) if _ID.fullmatch(program) else []

    def _require(self, program: str) -> list[int]:
        numbers = self._numbers(program)
        if not numbers:
            raise NotFoundError(f"program: there is no {shown(program)}; the list of programs has their ids")
        return numbers

    def _path(self, program: str, version: int) -> Path:
        return self._folder / program / f"{version}.json"

    def _read(self, program: str, version: int | None) -> ProgramVersion:
        example = self._examples.get(program)
        if example is not None and version in (None, example.version):
            return example
        numbers = [example.version] if example else self._require(program)
        number = numbers[-1] if version is None else version
        if number not in numbers:
            raise NotFoundError(
                f"version: program {shown(program)} has no version {number}; the versions {numbers[0]} "
                f"to {numbers[-1]} are kept"
            )
        path = self._path(program, number)
        try:
            return _FILE.validate_json(read_kept(path))
        except FileNotFoundError as exc:
            raise NotFoundError(f"program: {shown(program)} was deleted") from exc
        except OSError as exc:
            raise UnavailableError(f"{path}: cannot be read: {exc.strerror}") from exc
        except ValidationError as exc:
            raise UnavailableError(f"{path}: is damaged; save the program again or remove the file") from exc

    def _save(self, program: str, saved: ProgramText, base: int | None, author: str) -> ProgramVersion:
        numbers = self._numbers(program)
        if base != (numbers[-1] if numbers else None):
            return self._repeated_or_refused(program, saved, base, numbers)
        before = numbers[-1] if numbers else self._deleted_version(program)
        if not numbers and len(self._ids()) >= MAX_PROGRAMS:
            raise ConflictError(
                f"{MAX_PROGRAMS} programs are stored, which is the limit; delete one first",
                details={"cause": "full"},
            )
        time = utc_now(self._link.clock).isoformat(timespec="seconds")
        made = ProgramVersion(program, before + 1, author, time, saved)
        content = json.dumps(asdict(made), ensure_ascii=False, indent=1).encode()
        used = sum(each.stat().st_size for each in self._folder.glob("*/*.json"))
        if used + len(content) > MAX_TOTAL_BYTES:
            raise ConflictError(
                f"the stored programs have {used} bytes, allowed: {MAX_TOTAL_BYTES}; delete some first",
                details={"cause": "full"},
            )
        self._make_folder()
        keep(self._path(program, made.version), content, f"program {shown(program)}")
        for old in numbers[: len(numbers) + 1 - MAX_VERSIONS]:
            self._path(program, old).unlink(missing_ok=True)
        return made

    def _make_folder(self) -> None:
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as exc:
            raise UnavailableError(f"{self._folder}: cannot be created: {exc.strerror}") from exc

    def _deleted_version(self, program: str) -> int:
        """Return the last version number of a deleted program with this id."""
        return max([self._deleted().version_of(program), *_numbers_in(self._deleted_file(program))])

    def _deleted(self) -> Deleted:
        path = self._folder / DELETED
        try:
            return _DELETED.validate_json(read_kept(path))
        except FileNotFoundError:
            return Deleted({})
        except OSError as exc:
            raise UnavailableError(f"{path}: cannot be read: {exc.strerror}") from exc
        except ValidationError as exc:
            raise UnavailableError(
                f"{path}: is damaged; it contains the versions of deleted programs; remove it if no "
                "client has a deleted program open"
            ) from exc

    def _repeated_or_refused(
        self, program: str, saved: ProgramText, base: int | None, numbers: list[int]
    ) -> ProgramVersion:
        if not numbers:
            raise ChangedError(
                f"program {shown(program)}: version {base} has been deleted in the meantime; "
                "save it as a new program"
            )
        there, newest = self._read(program, None), numbers[-1]
        repeated = len(numbers) == 1 if base is None else newest == base + 1
        if repeated and there.saved == saved:
            return there
        based = f"yours is based on version {base}" if base else "yours is a new program"
        raise ChangedError(
            f"program {shown(there.saved.label)} ({program}): {there.author} saved version {newest} at "
            f"{there.time}, and {based}; load that version, or save yours under another name"
        )

    def _delete(self, program: str, base: int | None) -> ProgramVersion:
        numbers = self._require(program)
        newest = numbers[-1]
        try:
            there = self._read(program, None)
        except UnavailableError:  # a damaged program can be deleted too
            there = ProgramVersion(program, newest, "?", "?", ProgramText(program, "sequence", ""))
        if base is not None and base != newest:
            raise ChangedError(
                f"program {shown(there.saved.label)} ({program}): {there.author} saved version {newest} at "
                f"{there.time}; read it before you delete it"
            )
        aside = self._deleted_file(program)
        try:
            shutil.rmtree(aside, ignore_errors=True)
            (self._folder / program).rename(aside)
            for old in numbers[:-1]:
                (aside / f"{old}.json").unlink()
            os.truncate(aside / f"{newest}.json", 0)
        except OSError as exc:
            raise UnavailableError(f"{aside}: cannot be deleted: {exc.strerror}") from exc
        # On a full disk the file stays empty, but its name still states which version was deleted.
        with contextlib.suppress(UnavailableError):
            known = self._deleted().with_program(program, newest)
            keep(self._folder / DELETED, json.dumps(asdict(known)).encode(), f"program {shown(program)}")
            shutil.rmtree(aside, ignore_errors=True)
        return there

    def _deleted_file(self, program: str) -> Path:
        return self._folder / f".deleted-{program}"


def _example(program: ExampleProgram, started: str) -> ProgramVersion:
    slug = re.sub(r"[^a-z0-9_-]+", "-", program.file.stem.lower())[:50].strip("-")
    saved = ProgramText(program.label, program.kind, program.text, "comes with the cell")
    return ProgramVersion(f"example-{program.kind}-{slug}", 1, "the cell", started, saved, example=True)


def _numbers_in(folder: Path) -> list[int]:
    """List the numbers of the versions in a folder, in ascending order."""
    if not folder.is_dir():
        return []
    found = (_VERSION.fullmatch(each.name) for each in folder.iterdir())
    return sorted(int(each[1]) for each in found if each)


def _require_object(text: str) -> None:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as exc:
        raise InputError(f"text: is not JSON: {exc}") from exc
    if not isinstance(content, dict):
        raise InputError(f"text: a sequence file must be an object, got {shown(content)}")
